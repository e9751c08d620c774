#include "telenano/common/config/completion.h"

#include "telenano/common/config/shared_files.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <string>
#include <vector>

namespace telenano::config {
namespace {

/// The choices of an option, as its description shows them: "TEXT:{none,ks}" → "none ks"; of scenes, those
/// that come with the program. What ends in FILE goes on with a file's name: "replay:FILE" → "replay:".
std::string choices_of(const CLI::Option& option) {
  const std::string type = option.get_type_name();
  if (type == kSceneOrFile) {
    std::string names;
    for (const std::string& name : shared_names("scenes", ".toml"))
      names += (names.empty() ? "" : " ") + name;
    return names;
  }
  const auto from = type.find('{'), to = type.find('}');
  if (from == std::string::npos || to == std::string::npos || to < from) return "";
  std::string choices = type.substr(from + 1, to - from - 1);
  std::replace(choices.begin(), choices.end(), ',', ' ');
  const std::string tail = ":FILE";
  for (auto at = choices.find(tail); at != std::string::npos; at = choices.find(tail))
    choices.erase(at + 1, 4);
  return choices;
}

/// What may follow a command, and what may follow each of its flags. `path` is the words that lead to it:
/// "" for the program itself, "keys new".
void add_command(const CLI::App& command, const std::string& path, std::string& words, std::string& values) {
  std::string line;
  for (const CLI::App* below : command.get_subcommands({})) {
    line += below->get_name() + " ";
    add_command(*below, path.empty() ? below->get_name() : path + " " + below->get_name(), words, values);
  }
  for (const CLI::Option* option : command.get_options()) {
    for (const std::string& name : option->get_lnames()) {
      line += "--" + name + " ";
      if (option->get_items_expected_max() == 0) continue;  // a flag stands alone
      const std::string choices = choices_of(*option);
      values += "    '" + path + ":--" + name + "') " +
                (choices.empty() ? "" : "_choices='" + choices + "' ") +
                (choices.empty() || option->get_type_name() == kSceneOrFile ? "_files=1" : "") + " ;;\n";
    }
  }
  words += "    '" + path + "') _words='" + line + "' ;;\n";
}

}  // namespace

std::string bash_completion(const CLI::App& app) {
  std::string words, values;
  add_command(app, "", words, values);
  std::string function = "_" + app.get_name();
  std::replace(function.begin(), function.end(), '-', '_');
  return "# bash completion of " + app.get_name() + "; made by: " + app.get_name() + " --completion\n" +
         function +
         "() {\n"
         "  local _path='' _words='' _choices='' _files=0 _i _current=${COMP_WORDS[COMP_CWORD]} "
         "_before=${COMP_WORDS[COMP_CWORD-1]}\n"
         "  for ((_i = 1; _i < COMP_CWORD; ++_i)); do\n"
         "    [[ ${COMP_WORDS[_i]} =~ ^[a-z][a-z0-9-]*$ ]] || break\n"
         "    _path=${_path:+$_path }${COMP_WORDS[_i]}\n"
         "  done\n"
         "  case \"$_path:$_before\" in\n" +
         values +
         "  esac\n"
         "  case \"$_path\" in\n" +
         words +
         "  esac\n"
         "  if [[ -n $_choices ]]; then COMPREPLY=($(compgen -W \"$_choices\" -- \"$_current\"))\n"
         "    [[ $_files = 0 ]] || COMPREPLY+=($(compgen -f -- \"$_current\"))\n"
         "  elif [[ $_files = 1 ]]; then COMPREPLY=($(compgen -f -- \"$_current\"))\n"
         "  else COMPREPLY=($(compgen -W \"$_words\" -- \"$_current\"))\n"
         "    [[ ${#COMPREPLY[@]} != 0 ]] || COMPREPLY=($(compgen -f -- \"$_current\")); fi\n"
         "}\n"
         "complete -o filenames -F " +
         function + " " + app.get_name() + "\n";
}

}  // namespace telenano::config

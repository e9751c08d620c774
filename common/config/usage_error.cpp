#include "telenano/common/config/usage_error.h"

#include <algorithm>

#include "telenano/common/config/edit_distance.h"

namespace telenano::config {
namespace {

bool known(const std::string& word, const std::vector<std::string>& words) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

std::string meant(const std::string& word, const std::vector<std::string>& words) {
  const std::string nearest = nearest_name(word, words);
  return nearest.empty() ? "" : "; did you mean " + nearest + "?";
}

std::string list(const std::vector<std::string>& words) {
  std::string text;
  for (std::size_t i = 0; i < words.size(); ++i) {
    text += (i == 0 ? "" : i + 1 == words.size() ? " or " : ", ") + words[i];
  }
  return text;
}

}  // namespace

std::string usage_error(const std::string& program, const std::string& what,
                        const std::vector<std::string>& arguments, const std::vector<std::string>& commands,
                        const std::vector<std::string>& flags) {
  std::string text = what;
  if (arguments.empty()) {
    text = "a command is missing, expected " + list(commands);
  } else if (arguments[0].rfind('-', 0) != 0 && !known(arguments[0], commands)) {
    text =
        "unknown command '" + arguments[0] + "', expected " + list(commands) + meant(arguments[0], commands);
  } else {
    for (const std::string& argument : arguments) {
      const std::string flag = argument.substr(0, argument.find('='));
      if (flag.rfind("--", 0) != 0 || known(flag, flags)) continue;
      text = "unknown flag " + flag + meant(flag, flags);
      break;
    }
  }
  std::replace(text.begin(), text.end(), '\n', ' ');
  return program + ": " + text + " (see " + program + " --help)";
}

}  // namespace telenano::config

#include "telenano/master/view_model/start_choice.h"

#include <fmt/format.h>

#include <algorithm>
#include <string_view>

namespace telenano::view_model {
namespace {

bool is_plain(char c) {
  constexpr std::string_view kOthers = "@%+=:,./_-";
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
         kOthers.find(c) != std::string_view::npos;
}

// POSIX: within single quotes nothing is special but the quote itself.
std::string quoted(const std::string& word) {
  if (!word.empty() && std::all_of(word.begin(), word.end(), is_plain)) return word;
  std::string text = "'";
  for (const char c : word) text += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return text + "'";
}

/// A value that begins with a hyphen would be read as a flag: it goes into the flag's own word.
void add(const std::string& flag, const std::string& value, std::vector<std::string>& arguments) {
  if (value.empty()) return;
  if (value.front() == '-') {
    arguments.push_back(flag + "=" + value);
  } else {
    arguments.insert(arguments.end(), {flag, value});
  }
}

void add_server_scene(const StartChoice& choice, std::vector<std::string>& arguments) {
  add("--server-scene", choice.server_scene, arguments);
}

void add_keys(const StartChoice& choice, std::vector<std::string>& arguments) {
  add("--key", choice.key, arguments);
  add("--identity", choice.identity, arguments);
  add("--server-key", choice.server_key, arguments);
}

}  // namespace

std::vector<std::string> run_arguments(const StartChoice& choice) {
  std::vector<std::string> arguments{"run", "--server", choice.server, "--device", choice.device, "--view"};
  add_keys(choice, arguments);
  add_server_scene(choice, arguments);
  if (choice.method != "auto") arguments.insert(arguments.end(), {"--method", choice.method});
  if (choice.guide) arguments.emplace_back("--guide");
  if (choice.text_size != 1)
    arguments.insert(arguments.end(), {"--text-size", fmt::format("{:g}", choice.text_size)});
  if (choice.record) add("--record", choice.recording, arguments);
  return arguments;
}

std::vector<std::string> plan_arguments(const StartChoice& choice) {
  std::vector<std::string> arguments{"plan", "--server", choice.server, "--felt", "--method", choice.method};
  add_keys(choice, arguments);
  add_server_scene(choice, arguments);
  return arguments;
}

std::string shell_line(const std::string& program, const std::vector<std::string>& arguments) {
  std::string line = quoted(program);
  for (const std::string& argument : arguments) line += " " + quoted(argument);
  return line;
}

}  // namespace telenano::view_model

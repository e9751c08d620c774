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

void add_server_scene(const StartChoice& choice, std::vector<std::string>& arguments) {
  if (!choice.server_scene.empty())
    arguments.insert(arguments.end(), {"--server-scene", choice.server_scene});
}

void add_keys(const StartChoice& choice, std::vector<std::string>& arguments) {
  if (!choice.key.empty()) arguments.insert(arguments.end(), {"--key", choice.key});
  if (!choice.identity.empty()) arguments.insert(arguments.end(), {"--identity", choice.identity});
  if (!choice.server_key.empty()) arguments.insert(arguments.end(), {"--server-key", choice.server_key});
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
  if (choice.record) arguments.insert(arguments.end(), {"--record", choice.recording});
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

std::string choice_fault(const StartChoice& choice) {
  if (choice.server.empty()) return "Name a server: HOST:PORT of a telenano-nve serve";
  if (choice.server.find(':') == std::string::npos) return "The server needs its port: HOST:PORT";
  if (choice.identity.empty() != choice.server_key.empty())
    return choice.identity.empty() ? "Name this station's own key pair too, or clear the server's key"
                                   : "Name the server's key too: telenano-nve keys identity prints it";
  if (!choice.identity.empty() && !choice.key.empty())
    return "A key file or a key pair of its own: clear one";
  if (choice.record && choice.recording.empty()) return "Name the recording's file, or switch it off";
  return "";
}

}  // namespace telenano::view_model

#pragma once

#include <string>

namespace CLI {
class App;
}

namespace telenano::config {

/// Type name of an option that takes a scene: its name, or a file. What has words of its own to choose from
/// says so by a type name with braces, "{omega,hid}".
inline constexpr const char* kSceneOrFile = "SCENE|FILE";

/// A script by which bash completes this program's commands, flags and their choices; files where a flag
/// takes anything else. Made from the same description that parses the command line, so it cannot fall
/// behind. Source it, or put it into /usr/share/bash-completion/completions under the program's name.
std::string bash_completion(const CLI::App& app);

}  // namespace telenano::config

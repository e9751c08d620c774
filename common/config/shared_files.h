#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace telenano::config {

/// Where the files that come with the programs are (scenes/, data/, …): $TELENANO_SHARE where it is set, else
/// ../share/telenano as seen from this program, which holds for a build and for an installed package, from
/// whatever folder it is called.
std::filesystem::path shared_folder();

/// "flakes" → "/usr/share/telenano/scenes/flakes.toml". What names an existing file is that file, and
/// whatever has a slash in it is a path as it stands. Else it is looked up in `folder` of the shared files,
/// with or without `extension`. Throws UserError, one line with the names there are, if there is none.
std::string find_shared(const std::string& text, const std::string& folder, const std::string& extension);

/// The names that find_shared knows, sorted.
std::vector<std::string> shared_names(const std::string& folder, const std::string& extension);

}  // namespace telenano::config

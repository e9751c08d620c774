#pragma once

#include <string>

namespace telenano::security {

/// Files that hold secrets. `what` names the file's role in messages, e.g. "--key". No message ever contains
/// what is in the file.

/// The content. Throws UserError, one line with what to do, if the file cannot be read, is not a plain file,
/// belongs to somebody else than this user or root, or can be read or written by others.
std::string read_private_file(const std::string& path, const std::string& what);

/// Only the checks, for a file that somebody else reads.
void require_private_file(const std::string& path, const std::string& what);

/// A new file that only this user can read. Throws UserError if it exists.
void create_private_file(const std::string& path, const std::string& content, const std::string& what);

/// Puts `content` in place of a private file, or makes one: written beside it, brought to the disk, then
/// renamed, so that a reader sees the old or the new one. Two writers at once: the second gets a UserError.
void replace_private_file(const std::string& path, const std::string& content, const std::string& what);

}  // namespace telenano::security

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
/// renamed, so that a reader sees the old or the new one. Who changes what is in the file holds a
/// PrivateFileLock from before reading it; without, the second of two writers gets a UserError.
void replace_private_file(const std::string& path, const std::string& content, const std::string& what);

/// The right to read, change and replace the file at `path`, of one program at a time: a list that is read
/// outside of it may be written back over what another program has changed since. Kept by the kernel on
/// PATH.lock, which stays, for the life of the object; a program that is killed loses it.
class PrivateFileLock {
 public:
  /// Waits for others for up to `patience_ms`. Throws UserError if one keeps it for longer, or if PATH.lock
  /// cannot be made.
  PrivateFileLock(const std::string& path, const std::string& what, int patience_ms = 10'000);
  ~PrivateFileLock();
  PrivateFileLock(const PrivateFileLock&) = delete;
  PrivateFileLock& operator=(const PrivateFileLock&) = delete;

 private:
  int fd_ = -1;
};

}  // namespace telenano::security

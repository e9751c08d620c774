#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "telenano/common/hash/sha256.h"

namespace telenano::scene_store {

/// Scene bundles that were fetched before, so that they need not be fetched again: files of the user alone
/// (folder 0700, files 0600), named by their SHA-256. Of a file, nothing is believed: it is opened without
/// following links, must be a regular file of this user, and is used only if its bytes have the hash that is
/// asked for; one that has not is removed. Written beside and renamed, so that a file is whole or not there.
class SceneCache {
 public:
  static constexpr std::uint64_t kBytesMax = std::uint64_t{256} << 20;

  /// `folder` is made when something is kept. What else is in it stays. All files together have at most
  /// `bytes_max`: those used longest ago go.
  explicit SceneCache(std::filesystem::path folder, std::uint64_t bytes_max = kBytesMax)
      : folder_(std::move(folder)), bytes_max_(bytes_max) {}

  /// $XDG_CACHE_HOME/telenano/scenes, else ~/.cache/telenano/scenes; empty where neither is an absolute path.
  /// A folder of its own: what else is in telenano/ (fields of scans) may be anybody's to read.
  static std::filesystem::path users_folder();

  /// The bundle of this hash and size.
  std::optional<std::string> read(const Sha256& hash, std::uint64_t bytes) const;
  /// Keeps it. Empty, or one line that says why it is not kept.
  std::string keep(const Sha256& hash, const std::string& bundle) const;

  /// What a program found when it looked at the bundle of this hash (SceneChecker), so that it need not look
  /// again. `program` is 1 to 64 hexadecimal digits: another program finds its own. The file begins with the
  /// SHA-256 of what follows, and is not believed without.
  std::optional<std::string> read_finding(const Sha256& hash, const std::string& program) const;
  std::string keep_finding(const Sha256& hash, const std::string& program, const std::string& finding) const;

 private:
  std::string write(const std::string& name, const std::string& bytes) const;
  void make_room(std::uint64_t for_bytes) const;

  std::filesystem::path folder_;
  std::uint64_t bytes_max_;
};

}  // namespace telenano::scene_store

#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "telenano/nve_server/physics/surface/scan_fields.h"

namespace telenano::scene {

/// Fields of scans (scan_fields.h) kept in files, so that a second start need not make them.
///
/// A file belongs to what the fields are made from and nothing else: the heights as they are dilated, to the
/// last bit, the tip's radius, the softening's rule, the fixed softenings, and the version of the code that
/// makes them. All that is in the file again and is compared; its name is a hash of it. What is read is not
/// trusted: a file that is not the user's own, that others may write, that is no ordinary file, has another
/// size than its head says or more than kMostBytes, another key or checksum, or coefficients that no such
/// ground has, is as if it was not there. A checksum is no seal: who can write the user's own files can put
/// fields of another ground in, sound ones and therefore bounded; nothing worse.
///
/// Files are written beside and renamed, for the user alone (0600, the folder 0700). The folder holds at most
/// kMostBytes; the longest unused go first.
class FieldsCache {
 public:
  static constexpr std::uint64_t kMostBytes = std::uint64_t{1} << 30;

  /// The folder need not exist. `most_bytes`: of all files in it, and so of each.
  explicit FieldsCache(std::string folder, std::uint64_t most_bytes = kMostBytes)
      : folder_(std::move(folder)), most_bytes_(most_bytes) {}

  /// As the environment has it: $TELENANO_CACHE (a folder; "off" or empty: none), else telenano/fields in
  /// $CACHE_DIRECTORY, $XDG_CACHE_HOME or $HOME/.cache. Empty: none.
  static std::string folder_of_user();

  std::optional<physics::ScanFields> find(const physics::HeightGrid& grid, double tip_radius_nm,
                                          const physics::SofteningRule& rule,
                                          const std::vector<double>& fixed_softenings_nm = {},
                                          const physics::RetractionKernel* pull_off = nullptr) const;
  /// False if it could not be kept (no room, no right): nothing is lost but time. No throw.
  bool keep(const physics::HeightGrid& grid, double tip_radius_nm, const physics::SofteningRule& rule,
            const std::vector<double>& fixed_softenings_nm, const physics::ScanFields& fields,
            const physics::RetractionKernel* pull_off = nullptr) const noexcept;

  const std::string& folder() const noexcept { return folder_; }
  /// Of the file for these fields.
  std::string path(const physics::HeightGrid& grid, double tip_radius_nm, const physics::SofteningRule& rule,
                   const std::vector<double>& fixed_softenings_nm = {},
                   const physics::RetractionKernel* pull_off = nullptr) const;

 private:
  void make_room(std::uint64_t bytes) const;

  std::string folder_;
  std::uint64_t most_bytes_;
};

}  // namespace telenano::scene

#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "telenano/common/recording/child_call.h"
#include "telenano/common/surface/height_grid.h"

namespace telenano::scene_store {

/// What a bundle's scene is, as numbers that were looked at in a process of its own.
struct CheckedScene {
  std::string name;
  std::string text;                    ///< its description, which says the same as its numbers
  std::uint64_t scene_hash = 0;        ///< as Welcome::scene_hash names it
  std::uint64_t canonical_motion = 0;  ///< what this program makes of it
  surface::HeightGrid ground;          ///< finite heights, 2 × 2 to kGroundMax a side; none: flat
};

/// Reads scene bundles of strangers in a process of its own, under limits of processor time and memory: a
/// valid scene may be the bomb (a grating of 10⁷ periods). There it is decoded, its text is held against its
/// numbers, and its slave moves once along the canonical motion; what comes back are plain values, checked
/// again. One process for all bundles of a run, forked by the constructor: construct it before there are
/// threads.
class SceneChecker {
 public:
  static constexpr std::size_t kMemoryBytes = std::size_t{1} << 30;
  static constexpr int kGroundMax = 2048;

  explicit SceneChecker(std::size_t memory_bytes = kMemoryBytes, int seconds = 60);
  /// What it finds, as bytes for read_finding(). Throws UserError or RunError, one line; after a RunError
  /// this checker may have lost its process, and says so for each further bundle.
  std::string look_at(const std::string& bundle) { return child_.ask("S" + bundle); }
  /// The heights of a scan alone, in milliseconds, before anything is made of it: something to draw. Of any
  /// other surface, or one that cannot be drawn, none. Throws as look_at() does.
  surface::HeightGrid ground_of(const std::string& bundle);
  /// From another thread: a look that is under way ends at once, by a RunError, as every later one.
  void stop() noexcept { child_.stop(); }

 private:
  recording::ChildCall child_;
};

/// Throws RunError, one line, for what no look ends with.
CheckedScene read_finding(const std::string& finding);

}  // namespace telenano::scene_store

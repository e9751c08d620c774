#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "telenano/common/recording/child_call.h"
#include "telenano/common/surface/height_grid.h"

namespace telenano::scene_store {

/// What a picture needs of a scene.
struct SceneShape {
  double tip_radius_nm = 0;     ///< 0: not known
  surface::HeightGrid heights;  ///< finite, 2 × 2 to kGroundMax a side; none: flat
};

/// What a bundle's scene is, as numbers that were looked at in a process of its own.
struct CheckedScene {
  std::string name;
  std::string text;                    ///< its description, which says the same as its numbers
  std::uint64_t scene_hash = 0;        ///< as Welcome::scene_hash names it
  std::uint64_t canonical_motion = 0;  ///< what this program makes of it
  double tip_radius_nm = 0;
  surface::HeightGrid ground;  ///< as SceneShape::heights
};

/// Reads scene bundles of strangers in a process of its own, under limits of processor time and memory: a
/// valid scene may be the bomb (a grating of 10⁷ periods). There it is decoded, its text is held against its
/// numbers, and its slave moves once along the canonical motion; what comes back are plain values, checked
/// again. One process for all bundles of a run, and the next where it has come to its end; all are forked by the
/// constructor: construct it before there are threads.
class SceneChecker {
 public:
  using StillWanted = recording::ChildCall::StillWanted;
  static constexpr std::size_t kMemoryBytes = std::size_t{1} << 30;
  static constexpr int kGroundMax = 2048;
  static constexpr double kTipRadiusLeast_nm = 1;  ///< as a description may have it
  static constexpr double kTipRadiusMost_nm = 1e4;

  /// `seconds` of the processor's time for all looks of a process; of a look's own time too where nobody says how long
  /// it is wanted.
  explicit SceneChecker(std::size_t memory_bytes = kMemoryBytes, int seconds = 60, int processes = 1);
  /// What it finds, as bytes for read_finding(). Throws UserError or RunError, one line; after a RunError
  /// this checker may have lost a process, and where that was the last it says so for each further bundle.
  std::string look_at(const std::string& bundle, const StillWanted& still_wanted = nullptr) {
    return process().ask("S" + bundle, still_wanted);
  }
  /// The tip's radius and the heights of a scan alone, in milliseconds, before anything is made of it: something to
  /// draw. Of any other surface no heights. Throws as look_at() does.
  SceneShape shape_of(const std::string& bundle, const StillWanted& still_wanted = nullptr);
  /// From the thread that looks: the look that is under way goes on, after all else that this machine has to do.
  void give_way() noexcept { processes_[at_]->give_way(); }
  /// From another thread: a look that is under way ends at once, by a RunError, as every later one.
  void stop() noexcept;

 private:
  recording::ChildCall& process() noexcept;

  std::vector<std::unique_ptr<recording::ChildCall>> processes_;
  std::size_t at_ = 0;
};

/// Throws RunError, one line, for what no look ends with.
CheckedScene read_finding(const std::string& finding);

}  // namespace telenano::scene_store

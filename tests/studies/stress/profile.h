#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "tests/studies/stress/run_spec.h"

namespace telenano::studies::stress {

struct Range {
  double low = 0, high = 0;
  bool holds(double x) const noexcept { return x >= low && x <= high; }
};

/// Which runs a sweep consists of: a grid over everything that is known to matter, one thing at a time and
/// crossed where it should be, then random combinations, then adversaries that climb. The same options give
/// the same list.
struct ProfileOptions {
  bool full = false;
  bool replies = false;    ///< instead: runs in each of which replies are left out, whatever else there is
  std::size_t sample = 0;  ///< > 0: so many independent draws of everything, and no grid
  std::uint64_t seed = 1;
  std::vector<control::Method> methods;  ///< in the order of control::kAllMethods
  std::vector<SceneKind> scenes;
  /// Besides: calm hands that go across these, over a short way, with each method. Not of a sample, nor of replies.
  std::vector<SceneKind> across;
  Range rtt_ms{0, 1000};  ///< runs outside are left out; random ones are drawn inside
  Range loss{0, 0.5};

  /// One line: what a table must have been made with so that rows may be added to it.
  std::string text() const;
};

/// Whether a table with this line (`ProfileOptions::text`) holds independent draws, so that its rates are rates.
bool is_sample(std::string_view profile_text) noexcept;

/// Throws UserError where nothing is left.
std::vector<RunSpec> make_profile(const ProfileOptions& options);

}  // namespace telenano::studies::stress

#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "telenano/common/recording/recording_reader.h"

namespace telenano::programs {

/// What a hand was given in a recording: |force applied|, row by row.
struct FeltForce {
  double first_n = 0;  ///< in the first row
  double most_n = 0;
  double most_rise_n = 0;  ///< from one row to the next
};

inline FeltForce felt_force(const std::string& file) {
  const recording::RecordingReader reader(file);
  std::array<std::vector<double>, 3> axes;
  for (std::size_t axis = 0; axis < 3; ++axis) axes[axis] = reader.read("hand_force_applied_h_n", axis);
  FeltForce felt;
  double last_n = 0;
  for (std::size_t i = 0; i < reader.rows(); ++i) {
    const double force_n = std::hypot(axes[0][i], axes[1][i], axes[2][i]);
    if (i == 0) felt.first_n = force_n;
    felt.most_n = std::max(felt.most_n, force_n);
    felt.most_rise_n = std::max(felt.most_rise_n, force_n - last_n);
    last_n = force_n;
  }
  return felt;
}

}  // namespace telenano::programs

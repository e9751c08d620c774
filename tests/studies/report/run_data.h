#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "telenano/common/recording/curve_segments.h"
#include "telenano/common/recording/summary.h"

namespace telenano::studies {

using recording::CurveSegment;

/// What the figures need of one recording, in the units of their axes.
struct RunData {
  std::string label;
  std::string slug;  ///< the label as a file name
  std::filesystem::path path;
  recording::Summary summary;
  std::vector<std::pair<std::string, std::string>> configuration;

  std::string about(const std::string& key) const;  ///< of the configuration; empty when it does not say

  double surface_z_w_nm = 0;  ///< heights are above it
  bool surface_known = false;

  std::vector<double> time_s;  ///< from 0
  double largest_step_s = 0;   ///< further apart than this, rows have a hole between them
  std::vector<double> hand_z_mm;
  std::vector<double> target_height_nm;
  std::vector<double> tip_height_nm;  ///< NaN before the first reply, as all that comes with one
  std::vector<double> lateral_nm;     ///< distance from the start, in the plane
  std::vector<double> tip_force_nn;
  std::vector<double> scaled_force_n;   ///< along H z, before control
  std::vector<double> applied_force_n;  ///< along H z
  std::vector<double> energy_mj;
  std::vector<double> damper_n_s_m;
  std::vector<double> slave_energy_aj;  ///< put in and not given back
  std::vector<double> rtt_us;           ///< one a reply

  double stopped_s = -1;  ///< when the station stopped itself for a fault; -1 = it did not

  std::string stop_reason;

  std::vector<CurveSegment> segments;
  std::vector<std::pair<double, double>> contacts;  ///< from, to, in seconds; at most 60
};

/// A label as part of a file name.
std::string slug_of(const std::string& label);

/// Throws UserError for a file that is not a recording or holds no row.
RunData load_run(const std::string& label, const std::filesystem::path& path);

}  // namespace telenano::studies

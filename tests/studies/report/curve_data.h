#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace telenano::studies {

/// One way of a force-distance curve. Snap-in and pull-off are jumps from one row to the next.
struct CurveWay {
  std::vector<double> base_z_nm;
  std::vector<double> force_nn;
  std::vector<std::size_t> jumps;  ///< row i + 1 is on the other side of a jump from row i
};

/// What `telenano-nve curve` prints.
struct CurveData {
  std::filesystem::path path;
  CurveWay approach;
  CurveWay retract;
  double loop_work_aj = 0;       ///< of the base over the whole way there and back
  double pull_off_force_nn = 0;  ///< largest attraction on the way back, >= 0
  double pull_off_base_nm = 0;   ///< where the tip lets go
  double snap_in_base_nm = 0;
  bool snaps_in = false;
  bool lets_go = false;
};

/// Throws UserError, naming file, line and column, for anything else than the output of `telenano-nve curve`.
CurveData load_curve(const std::filesystem::path& path);

}  // namespace telenano::studies

#pragma once

#include <iosfwd>
#include <string>
#include <string_view>
#include <vector>

#include "telenano/common/base/vec3.h"

namespace telenano::device {

/// The three tasks of Kim & Sitti's fig. 15, a raster scan, and a script.
enum class Task { kPosition, kContact, kIndent, kScan, kScript };
Task parse_task(std::string_view name);  ///< throws UserError
std::string_view task_name(Task task) noexcept;

struct TaskOptions {
  double start_height_nm = 40;  ///< of the tip above the surface when the session starts; < 0: it presses
  double duration_s = 10;       ///< of the whole task; its parts keep their proportions
  double hover_low_nm = 10;     ///< position: wanders between these heights
  double hover_high_nm = 20;
  double depth_nm = 5;            ///< indent: intended depth
  double contact_depth_nm = 0.5;  ///< contact, scan: intended depth, so that contact is kept
  double retract_nm = 40;         ///< height to which the tip leaves, beyond any pull-off
  double scan_size_nm = 40;       ///< scan: side of the raster
  int scan_lines = 5;
};

/// What the operator intends the tip to do: smooth from one point of rest to the next along
/// s(τ) = 10τ³ − 15τ⁴ + 6τ⁵, the motion of least jerk that human reaching follows [Flash & Hogan 1985].
/// x, y in nm from where the session starts, z in nm above the surface there.
class IntendedMotion {
 public:
  struct Waypoint {
    double time_s = 0;
    Vec3 pos_nm = Vec3::Zero();
  };

  /// At least one waypoint, times rising strictly; throws UserError.
  explicit IntendedMotion(std::vector<Waypoint> waypoints);

  static IntendedMotion for_task(Task task, const TaskOptions& options);
  /// CSV with the header t_s,x_nm,y_nm,z_nm. Throws UserError with file, line and what is expected.
  static IntendedMotion from_csv(std::istream& input, const std::string& file_name);
  static IntendedMotion from_csv_file(const std::string& file_name);

  /// The same motion, after a smooth way from `start_nm` to its first waypoint if it does not begin there.
  IntendedMotion beginning_at(const Vec3& start_nm, double approach_s) const;

  Vec3 pos_nm(double time_s) const noexcept;  ///< at rest before the first and after the last waypoint
  double duration_s() const noexcept { return waypoints_.back().time_s; }
  const std::vector<Waypoint>& waypoints() const noexcept { return waypoints_; }

 private:
  std::vector<Waypoint> waypoints_;
};

}  // namespace telenano::device

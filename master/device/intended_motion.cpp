#include "telenano/master/device/intended_motion.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <fstream>
#include <istream>
#include <utility>

#include "telenano/common/base/error.h"

namespace telenano::device {
namespace {

constexpr std::array<std::string_view, 5> kTaskNames = {"position", "contact", "indent", "scan", "script"};
constexpr std::string_view kCsvHeader = "t_s,x_nm,y_nm,z_nm";
constexpr std::size_t kMaxWaypoints = 1'000'000;
constexpr double kMaxTimeS = 86'400;
constexpr double kMaxPosNm = 1e6;

std::string_view trimmed(std::string_view text) {
  const auto space = [](char c) { return c == ' ' || c == '\t' || c == '\r'; };
  while (!text.empty() && space(text.front())) text.remove_prefix(1);
  while (!text.empty() && space(text.back())) text.remove_suffix(1);
  return text;
}

bool parse_row(std::string_view line, std::array<double, 4>& row) {
  for (std::size_t i = 0; i < row.size(); ++i) {
    const std::size_t comma = line.find(',');
    if ((comma == std::string_view::npos) != (i + 1 == row.size())) return false;
    const std::string_view cell = trimmed(line.substr(0, comma));
    const auto [end, error] = std::from_chars(cell.data(), cell.data() + cell.size(), row[i]);
    if (error != std::errc() || end != cell.data() + cell.size() || !std::isfinite(row[i])) return false;
    if (comma != std::string_view::npos) line.remove_prefix(comma + 1);
  }
  return row[0] >= 0 && row[0] <= kMaxTimeS && std::fabs(row[1]) <= kMaxPosNm &&
         std::fabs(row[2]) <= kMaxPosNm && std::fabs(row[3]) <= kMaxPosNm;
}

void require_of_task(bool good, const char* key, double value, const char* range) {
  if (good) return;
  throw UserError("task: " + std::string(key) + " = " + std::to_string(value) + ", expected " + range);
}

void check(const TaskOptions& options) {
  const auto between = [](double value, double low, double high) { return value >= low && value <= high; };
  // Below the surface where a session is resumed whose tip still presses.
  require_of_task(between(options.start_height_nm, -kMaxPosNm, kMaxPosNm), "start_height_nm",
                  options.start_height_nm, "-1e6 to 1e6");
  require_of_task(between(options.duration_s, 0.1, kMaxTimeS), "duration_s", options.duration_s,
                  "0.1 to 86400");
  require_of_task(between(options.hover_low_nm, 0, kMaxPosNm), "hover_low_nm", options.hover_low_nm,
                  "0 to 1e6");
  require_of_task(between(options.hover_high_nm, options.hover_low_nm, kMaxPosNm), "hover_high_nm",
                  options.hover_high_nm, "hover_low_nm to 1e6");
  require_of_task(between(options.depth_nm, 0, kMaxPosNm), "depth_nm", options.depth_nm, "0 to 1e6");
  require_of_task(between(options.contact_depth_nm, -kMaxPosNm, kMaxPosNm), "contact_depth_nm",
                  options.contact_depth_nm, "-1e6 to 1e6");
  require_of_task(between(options.retract_nm, 0, kMaxPosNm), "retract_nm", options.retract_nm, "0 to 1e6");
  require_of_task(between(options.scan_size_nm, 0, kMaxPosNm), "scan_size_nm", options.scan_size_nm,
                  "0 to 1e6");
  require_of_task(options.scan_lines >= 1 && options.scan_lines <= 10'000, "scan_lines", options.scan_lines,
                  "1 to 10000");
}

}  // namespace

Task parse_task(std::string_view name) {
  for (std::size_t i = 0; i < kTaskNames.size(); ++i) {
    if (kTaskNames[i] == name) return static_cast<Task>(i);
  }
  throw UserError("task '" + std::string(name) +
                  "' is unknown; use position, contact, indent, scan or script");
}

std::string_view task_name(Task task) noexcept {
  return kTaskNames[static_cast<std::size_t>(task)];
}

IntendedMotion::IntendedMotion(std::vector<Waypoint> waypoints) : waypoints_(std::move(waypoints)) {
  if (waypoints_.empty()) throw UserError("motion: no waypoint, expected at least one");
  for (std::size_t i = 0; i < waypoints_.size(); ++i) {
    const bool rises = i == 0 || waypoints_[i].time_s > waypoints_[i - 1].time_s;
    if (!std::isfinite(waypoints_[i].time_s) || !is_finite(waypoints_[i].pos_nm) || !rises) {
      throw UserError("motion: waypoint " + std::to_string(i + 1) +
                      " expected finite, with a time after the last");
    }
  }
}

IntendedMotion IntendedMotion::for_task(Task task, const TaskOptions& options) {
  check(options);
  std::vector<Waypoint> points;
  const auto go = [&](double fraction, double x_nm, double y_nm, double z_nm) {
    points.push_back({fraction * options.duration_s, Vec3(x_nm, y_nm, z_nm)});
  };
  constexpr double kNearNm = 3;  // a pause above the surface before it is touched
  go(0, 0, 0, options.start_height_nm);
  switch (task) {
    case Task::kPosition: {
      const double middle_nm = 0.5 * (options.hover_low_nm + options.hover_high_nm);
      go(0.20, 0, 0, options.hover_high_nm);
      go(0.30, 0, 0, options.hover_high_nm);
      go(0.40, 0, 0, options.hover_low_nm);
      go(0.50, 0, 0, options.hover_low_nm);
      go(0.60, 0, 0, middle_nm);
      go(0.70, 0, 0, options.hover_high_nm);
      go(0.80, 0, 0, options.hover_low_nm);
      go(0.90, 0, 0, middle_nm);
      go(1.00, 0, 0, middle_nm);
      break;
    }
    case Task::kContact:
      go(0.25, 0, 0, kNearNm);
      go(0.30, 0, 0, kNearNm);
      go(0.40, 0, 0, -options.contact_depth_nm);
      go(0.70, 0, 0, -options.contact_depth_nm);
      go(0.95, 0, 0, options.retract_nm);
      go(1.00, 0, 0, options.retract_nm);
      break;
    case Task::kIndent:
      go(0.25, 0, 0, kNearNm);
      go(0.30, 0, 0, kNearNm);
      go(0.50, 0, 0, -options.depth_nm);
      go(0.65, 0, 0, -options.depth_nm);
      go(0.95, 0, 0, options.retract_nm);
      go(1.00, 0, 0, options.retract_nm);
      break;
    case Task::kScan: {
      const double half_nm = 0.5 * options.scan_size_nm;
      const int lines = options.scan_lines;
      go(0.15, -half_nm, -half_nm, options.hover_low_nm);
      go(0.20, -half_nm, -half_nm, -options.contact_depth_nm);
      for (int line = 0; line < lines; ++line) {
        const double y_nm = lines == 1 ? 0.0 : -half_nm + options.scan_size_nm * line / (lines - 1);
        const double begin = 0.20 + 0.65 * line / lines;
        const double side = line % 2 == 0 ? 1.0 : -1.0;
        go(begin + 0.65 / lines * 0.1, -side * half_nm, y_nm, -options.contact_depth_nm);
        go(begin + 0.65 / lines, side * half_nm, y_nm, -options.contact_depth_nm);
      }
      const double x_nm = points.back().pos_nm.x();
      go(0.95, x_nm, points.back().pos_nm.y(), options.retract_nm);
      go(1.00, x_nm, points.back().pos_nm.y(), options.retract_nm);
      break;
    }
    case Task::kScript:
      throw UserError("task 'script' needs a CSV file of waypoints: " + std::string(kCsvHeader));
  }
  return IntendedMotion(std::move(points));
}

IntendedMotion IntendedMotion::from_csv(std::istream& input, const std::string& file_name) {
  std::vector<Waypoint> points;
  std::string line;
  std::size_t number = 0;
  bool header_seen = false;
  const auto fail = [&](const std::string& what) {
    throw UserError(file_name + ":" + std::to_string(number) + ": " + what);
  };
  while (std::getline(input, line)) {
    ++number;
    if (line.size() > 1000) fail("line longer than 1000 characters");
    const std::string_view text = trimmed(line);
    if (text.empty() || text.front() == '#') continue;
    if (!header_seen) {
      if (text != kCsvHeader) fail("expected the header " + std::string(kCsvHeader));
      header_seen = true;
      continue;
    }
    std::array<double, 4> row{};
    if (!parse_row(text, row)) {
      fail("expected four finite numbers " + std::string(kCsvHeader) +
           ", time 0 to 86400 s, positions within +-1e6 nm");
    }
    if (!points.empty() && !(row[0] > points.back().time_s))
      fail("expected t_s to increase from line to line");
    if (points.size() >= kMaxWaypoints) fail("more than a million waypoints");
    points.push_back({row[0], Vec3(row[1], row[2], row[3])});
  }
  if (points.empty())
    throw UserError(file_name + ": no waypoints, expected " + std::string(kCsvHeader) + " and rows");
  return IntendedMotion(std::move(points));
}

IntendedMotion IntendedMotion::from_csv_file(const std::string& file_name) {
  std::ifstream file(file_name);
  if (!file) throw UserError(file_name + ": cannot be read, expected a CSV file " + std::string(kCsvHeader));
  return from_csv(file, file_name);
}

IntendedMotion IntendedMotion::beginning_at(const Vec3& start_nm, double approach_s) const {
  if ((waypoints_.front().pos_nm - start_nm).norm() <= 1e-6) return *this;
  std::vector<Waypoint> points{{0, start_nm}};
  for (Waypoint point : waypoints_) {
    point.time_s += approach_s;
    points.push_back(point);
  }
  return IntendedMotion(std::move(points));
}

Vec3 IntendedMotion::pos_nm(double time_s) const noexcept {
  const auto after = std::upper_bound(waypoints_.begin(), waypoints_.end(), time_s,
                                      [](double time, const Waypoint& point) { return time < point.time_s; });
  if (after == waypoints_.begin()) return waypoints_.front().pos_nm;
  if (after == waypoints_.end()) return waypoints_.back().pos_nm;
  const Waypoint& from = *(after - 1);
  const double tau = (time_s - from.time_s) / (after->time_s - from.time_s);
  const double s = tau * tau * tau * (10 + tau * (6 * tau - 15));
  return from.pos_nm + s * (after->pos_nm - from.pos_nm);
}

}  // namespace telenano::device

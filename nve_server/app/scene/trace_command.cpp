#include "telenano/nve_server/app/scene/trace_command.h"

#include <unistd.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <memory>
#include <string>
#include <utility>

#include "telenano/common/base/error.h"
#include "telenano/common/config/completion.h"
#include "telenano/common/config/program.h"
#include "telenano/common/surface/gsf.h"
#include "telenano/nve_server/app/scene/path_file.h"
#include "telenano/nve_server/app/scene/scene_loading.h"
#include "telenano/nve_server/scene/force_curve.h"
#include "telenano/nve_server/scene/scene.h"
#include "telenano/nve_server/slave/nve_slave.h"

namespace telenano::app {
namespace {

struct TraceOptions {
  std::string scene;
  std::string path;
  std::string csv;
  std::string surface;
  double rate_hz = 1000;
};

// Standard output, or a file that is closed in the end with its errors seen.
class Output {
 public:
  explicit Output(const std::string& path) : path_(path) {
    if (path_.empty()) return;
    file_ = std::fopen(path_.c_str(), "w");
    if (file_ == nullptr) {
      throw RunError(path_ + ": the result cannot be written: " + std::strerror(errno));
    }
  }
  ~Output() {
    if (!path_.empty() && file_ != nullptr) std::fclose(file_);
  }
  Output(const Output&) = delete;
  Output& operator=(const Output&) = delete;
  std::FILE* file() const { return file_; }
  void finish() {
    if (path_.empty()) {
      std::fflush(stdout);
      config::require_stdout();
      return;
    }
    const bool good = std::ferror(file_) == 0 && std::fflush(file_) == 0;
    const bool closed = std::fclose(std::exchange(file_, nullptr)) == 0;
    if (!good || !closed) throw RunError(path_ + ": the result cannot be written: " + std::strerror(errno));
  }

 private:
  std::string path_;
  std::FILE* file_ = stdout;
};

// On a terminal only, and not more often than a person can read.
class Progress {
 public:
  explicit Progress(std::size_t rows) : rows_(rows), shown_(isatty(STDERR_FILENO) != 0) {}
  void at(std::size_t row) {
    const auto percent = static_cast<int>(100.0 * static_cast<double>(row) / static_cast<double>(rows_));
    if (!shown_ || percent == last_) return;
    last_ = percent;
    std::fprintf(stderr, "\rtrace: %3d %%", percent);
  }
  ~Progress() {
    if (shown_ && last_ >= 0) std::fprintf(stderr, "\r             \r");
  }

 private:
  std::size_t rows_;
  bool shown_;
  int last_ = -1;
};

void write_row(std::FILE* file, double t_s, const Vec3& end, const slave::SlaveOutput& out,
               const slave::NveSlave::Trace& trace) {
  std::fprintf(file,
               "%.9g,%.15g,%.15g,%.15g,%.15g,%.15g,%.15g,%.15g,%.15g,%.15g,%.15g,%s,%.15g,%.15g,%.15g,%u\n",
               t_s, end.x(), end.y(), end.z(), out.tip_pos_w_nm.x(), out.tip_pos_w_nm.y(),
               out.tip_pos_w_nm.z(), out.force_w_nn.x(), out.force_w_nn.y(), out.force_w_nn.z(),
               out.deflection_nm, scene::branch_name(trace.tip.branch), out.energy_in_aj - out.energy_out_aj,
               trace.stored_aj, trace.dissipated_aj, out.fault_bits);
}

void run(const TraceOptions& options) {
  const std::vector<PathPoint> path = read_path(options.path);
  const auto scene = load_scene(options.scene);
  slave::NveSlave slave(scene);
  if (!options.surface.empty() && slave.marked_surface() == nullptr) {
    throw UserError(options.scene +
                    ": --save-surface needs a sample that keeps marks: give [sample] hardness_gpa");
  }
  Output output(options.csv);
  std::fputs(
      "t_s,end_x_nm,end_y_nm,end_z_nm,tip_x_nm,tip_y_nm,tip_z_nm,force_x_nn,force_y_nn,force_z_nn,"
      "deflection_nm,branch,work_aj,stored_aj,dissipated_aj,fault_bits\n",
      output.file());
  Progress progress(path.size());
  std::size_t faulty = 0;
  Vec3 from = slave.limits().start_pos_w_nm;
  double t_s = path.front().t_s;
  const double first_leg_s = (path.front().end_w_nm - from).norm() / scene->limits.speed_max_nm_s;
  for (std::size_t row = 0; row < path.size(); ++row) {
    // To the first row as fast as the scene allows, from there on along straight lines in the path's time.
    const double leg_s = row == 0 ? first_leg_s : path[row].t_s - t_s;
    const double pieces = std::max(1.0, std::ceil(leg_s * options.rate_hz * (1.0 - 1e-12)));
    if (pieces > 1e8)
      throw UserError(options.path + ": row " + std::to_string(row + 1) + " takes more than 1e8 steps");
    const double dt_s = std::max(leg_s / pieces, 1e-6);
    slave::SlaveOutput out;
    const auto steps = static_cast<std::int64_t>(pieces);
    for (std::int64_t i = 1; i <= steps; ++i) {
      const double part = static_cast<double>(i) / pieces;
      slave::SlaveInput input;
      input.tip_target_pos_w_nm =
          i == steps ? path[row].end_w_nm : Vec3(from + (path[row].end_w_nm - from) * part);
      slave.step(input, dt_s, out);
      if (out.fault_bits != 0) ++faulty;
    }
    t_s = path[row].t_s;
    from = path[row].end_w_nm;
    config::require_stdout();
    write_row(output.file(), t_s, slave.trace().commanded_end_w_nm, out, slave.trace());
    progress.at(row);
  }
  output.finish();
  if (faulty != 0) {
    std::fprintf(
        stderr,
        "telenano-nve: warning: %zu steps were held back by a limit, or had no balance (fault_bits)\n",
        faulty);
  }
  if (!options.surface.empty()) {
    surface::Scan scan;
    scan.grid = slave.marked_surface()->heights();
    scan.title = scene->name;
    scan.in_frame_w = true;
    surface::write_gsf(options.surface, scan);
  }
}

}  // namespace

void add_trace_command(CLI::App& app) {
  CLI::App* command = app.add_subcommand(
      "trace", "Move the tip along a path from a file; writes forces as CSV and marks as .gsf");
  auto options = std::make_shared<TraceOptions>();
  command
      ->add_option("--scene", options->scene,
                   "Scene: a file (TOML) or the name of a supplied scene, e.g. flakes")
      ->required()
      ->type_name(config::kSceneOrFile);
  command
      ->add_option("--path", options->path,
                   "CSV with the header t_s,x_nm,y_nm,z_nm: path of the commanded end, frame W")
      ->required()
      ->type_name("FILE");
  command->add_option("--csv", options->csv, "Output file (default: standard output)")->type_name("FILE");
  command
      ->add_option("--save-surface", options->surface, "Write the surface with its marks to this file (.gsf)")
      ->type_name("FILE");
  command->add_option("--rate-hz", options->rate_hz, "Steps per second between the rows of the path")
      ->capture_default_str()
      ->check(CLI::Range(1.0, 1e6));
  command->footer(
      "Prints one row for each row of the path: the position that the commanded end reached (the "
      "scene's limits apply),\nthe tip's apex, the force on the tip, the deflection (force/k_z, up "
      "positive), the branch, the work done by the end\nsince the start, the energy stored, the "
      "energy dissipated, and the fault bits of PROTOCOL.md.");
  command->callback([options] { run(*options); });
}

}  // namespace telenano::app

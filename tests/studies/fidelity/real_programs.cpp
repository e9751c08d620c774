#include "tests/studies/fidelity/real_programs.h"

#include <fmt/format.h>
#include <signal.h>

#include <chrono>
#include <cmath>
#include <cstdlib>
#include <fstream>

#include "telenano/common/base/error.h"
#include "telenano/common/recording/recording_reader.h"
#include "tests/support/child_process.h"

namespace telenano::studies::fidelity {
namespace {

using support::ChildProcess;

constexpr std::chrono::seconds kStarts{30};  // nothing here takes so long: only a program that hangs does

std::filesystem::path program(const std::string& name) {
  const std::filesystem::path here = std::filesystem::read_symlink("/proc/self/exe").parent_path();
  const std::filesystem::path path = here / name;
  if (!std::filesystem::exists(path))
    throw UserError("fidelity: --real: " + path.string() + " is missing; build " + name);
  return path;
}

/// The port at the end of a line that a program says when it listens.
std::string said_port(ChildProcess& child, const std::string& before) {
  if (!child.wait_for_err(before, kStarts) || !child.wait_for_err("\n", kStarts))
    throw RunError("fidelity: --real: a program does not start: " + child.err());
  const std::string text = child.err();
  return std::to_string(std::atoi(text.c_str() + text.find(before) + before.size()));
}

void write_script(const std::filesystem::path& file, const SceneMotion& motion) {
  std::ofstream out(file);
  out << "t_s,x_nm,y_nm,z_nm\n";
  for (const auto& w : motion.script)
    out << fmt::format("{},{},{},{}\n", w.time_s, w.pos_nm.x(), w.pos_nm.y(), w.pos_nm.z());
  if (!out.flush()) throw RunError(file.string() + ": cannot be written");
}

Vec3 vec3(const recording::Xyz& v) {
  return {v[0], v[1], v[2]};
}

TouchOutcome beside_truth(const std::filesystem::path& file, slave::Slave& truth) {
  const recording::RecordingReader reader(file);
  std::vector<recording::Sample> rows(reader.rows());
  reader.read_samples(0, rows);
  TouchOutcome outcome;
  if (rows.empty()) throw RunError(file.string() + ": the recording is empty");
  outcome.trace.period_s = 1e-3;
  slave::SlaveOutput output;
  std::int64_t touching = 0, clamped = 0;
  for (const recording::Sample& row : rows) {
    slave::SlaveInput input;
    input.follow = row.station_mode == static_cast<std::uint32_t>(station::Mode::kEngaged);
    input.tip_target_pos_w_nm = vec3(row.tip_target_w_nm);
    truth.step(input, row.dt_s, output);
    const double n_per_nn = 1e-9 * row.force_scale;
    const bool touches = output.contact_state == link::ContactState::kContact;
    outcome.trace.rows.push_back(
        {vec3(row.hand_force_applied_h_n), n_per_nn * output.force_w_nn, vec3(row.hand_pos_h_m), touches});
    touching += touches;
    clamped += touches && (row.limit_flags & recording::kLimitClamp) != 0;
    if (outcome.stopped_s < 0 && (row.limit_flags & recording::kLimitStop) != 0)
      outcome.stopped_s = row.time_s;
  }
  if (touching > 0) outcome.clamped_share = static_cast<double>(clamped) / static_cast<double>(touching);
  return outcome;
}

}  // namespace

CellResult run_real(const SceneMotion& motion, const std::string& method, const RealLink& link,
                    const ScenePairs& scenes, const std::filesystem::path& folder) {
  std::filesystem::create_directories(folder);
  const std::string stem = fmt::format("{}_{}_{}", motion.scene, motion.motion, method);
  const std::filesystem::path script = folder / (stem + ".csv"), file = folder / (stem + ".h5");
  write_script(script, motion);
  CellResult result;
  result.cell.motion = &motion;
  result.cell.rtt_ms = link.rtt_ms;
  result.cell.loss = link.loss;
  result.cell.keep_trace = true;
  if (method != "auto") result.cell.method = control::parse_method(method);

  const auto& pair = scenes.of(motion.scene);
  const std::unique_ptr<slave::Slave> truth = pair.make_truth();
  const control::Scaling scaling = planned_scaling(truth->limits(), {}, 1000, motion.velocity_scale);
  ChildProcess server({program("telenano-nve"), "serve", "--scene", motion.scene, "--listen", "127.0.0.1:0"});
  const std::string server_at = "127.0.0.1:" + said_port(server, " on 127.0.0.1:");
  ChildProcess relay({program("telenano-lab"), "relay", "--listen", "127.0.0.1:0", "--to", server_at,
                      "--delay-ms", fmt::format("{:g}", 0.5 * link.rtt_ms), "--loss",
                      fmt::format("{:g}", link.loss)});
  const std::string relay_at = "127.0.0.1:" + said_port(relay, "relay on 127.0.0.1:");
  const support::Finished run = support::run_program({program("telenano-master"),
                                                      "run",
                                                      "--server",
                                                      relay_at,
                                                      "--device",
                                                      "sim",
                                                      "--task",
                                                      "script",
                                                      "--script",
                                                      script,
                                                      "--method",
                                                      method,
                                                      "--velocity-scale",
                                                      fmt::format("{}", scaling.velocity),
                                                      "--force-scale",
                                                      fmt::format("{}", scaling.force),
                                                      "--allow-unsafe-scaling",
                                                      "--record",
                                                      file,
                                                      "--overwrite",
                                                      "--rt-priority",
                                                      "0",
                                                      "--no-view"},
                                                     {}, std::chrono::seconds(120));
  relay.signal(SIGTERM);
  server.signal(SIGTERM);
  relay.wait(kStarts);
  server.wait(kStarts);
  if (run.exit_code != 0) throw RunError("fidelity: --real: telenano-master: " + run.err);
  result.run = beside_truth(file, *truth);
  result.metrics = measure(result.run.trace, 0.1 + 1.5e-3 * link.rtt_ms);
  return result;
}

}  // namespace telenano::studies::fidelity

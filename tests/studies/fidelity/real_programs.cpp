#include "tests/studies/fidelity/real_programs.h"

#include <fmt/format.h>
#include <signal.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <thread>
#include <utility>

#include "telenano/common/base/error.h"
#include "telenano/common/recording/recording_reader.h"
#include "telenano/common/rt/steady_clock.h"
#include "telenano/nve_server/slave/logged_step.h"
#include "tests/studies/fidelity/step_tap.h"
#include "tests/studies/relay/relay.h"
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

/// The relay in a thread of its own, with an eye on the steps that go through it.
class TappedRelay {
 public:
  TappedRelay(const net::Address& to, const RealLink& link) : relay_(config(to, link), clock_) {
    thread_ = std::thread([this] {
      while (!stop_) relay_.step(20'000'000);
    });
  }
  ~TappedRelay() { end(); }
  TappedRelay(const TappedRelay&) = delete;
  TappedRelay& operator=(const TappedRelay&) = delete;
  std::string address() const { return net::to_string(relay_.local()); }
  const StepTap& end() {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
    return tap_;
  }

 private:
  RelayConfig config(const net::Address& to, const RealLink& link) {
    RelayConfig c;
    c.listen = net::parse_address("127.0.0.1:0", "the relay");
    c.to = to;
    c.to_server.delay_ns = c.to_client.delay_ns = static_cast<std::int64_t>(0.5e6 * link.rtt_ms);
    c.to_server.loss = c.to_client.loss = link.loss;
    c.tap = [this](std::span<const std::uint8_t> bytes, bool up) { tap_.see(bytes, up); };
    return c;
  }

  StepTap tap_;
  rt::SteadyClock clock_;
  Relay relay_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

/// The truth of a session without a log of steps: once a tick, along the path that the station commanded.
class PathTruth {
 public:
  explicit PathTruth(slave::Slave& slave) : slave_(slave) {}
  const slave::SlaveOutput& at(const recording::Sample& row) {
    slave::SlaveInput input;
    input.follow = row.station_mode == static_cast<std::uint32_t>(station::Mode::kEngaged);
    input.tip_target_pos_w_nm = vec3(row.tip_target_w_nm);
    slave_.step(input, row.dt_s, output_);
    return output_;
  }

 private:
  slave::Slave& slave_;
  slave::SlaveOutput output_;
};

/// The truth of one with a log: of a tick, what the steps up to its own make of the sample. A tick is one
/// step, from the first one of the session on; the recording begins a few of them later or earlier.
class LogTruth {
 public:
  LogTruth(slave::Slave& slave, std::vector<link::LoggedStep> log, const std::vector<recording::Sample>& rows)
      : slave_(slave), log_(std::move(log)), last_w_nm_(slave.limits().start_pos_w_nm) {
    // The target travels on a grid, so that the path itself says which step is whose.
    std::size_t fewest = SIZE_MAX;
    for (std::int64_t shift = -kShiftMost; shift <= kShiftMost; ++shift) {
      std::size_t others = 0;
      for (std::size_t i = 0; i < rows.size(); ++i) others += is_step_of(rows[i], i, shift) ? 0 : 1;
      if (others < fewest) fewest = others, shift_ = shift;
    }
  }
  /// Is the step of this tick in the log?
  bool knows(const recording::Sample& row, std::size_t tick) const { return is_step_of(row, tick, shift_); }
  const slave::SlaveOutput& at(std::size_t tick) {
    const std::int64_t until = static_cast<std::int64_t>(tick) + 1 + shift_;
    for (; done_ < log_.size() && static_cast<std::int64_t>(done_) < until; ++done_) {
      const Vec3 to_w_nm = link::target_w_nm(log_[done_]);
      const double dt_s = link::dt_s(log_[done_]);
      const bool was_up = (output_.fault_bits & link::kFaultRetracted) != 0;
      slave_.step(slave::input_of(to_w_nm, (to_w_nm - last_w_nm_) / dt_s, log_[done_].flags, true, was_up),
                  dt_s, output_);
      last_w_nm_ = to_w_nm;
    }
    return output_;
  }

 private:
  static constexpr std::int64_t kShiftMost = 100;
  bool is_step_of(const recording::Sample& row, std::size_t tick, std::int64_t shift) const {
    const std::int64_t k = static_cast<std::int64_t>(tick) + shift;
    return k >= 0 && k < static_cast<std::int64_t>(log_.size()) &&
           (link::target_w_nm(log_[static_cast<std::size_t>(k)]) - vec3(row.tip_target_w_nm)).norm() <
               link::kStepGridNm;
  }

  slave::Slave& slave_;
  std::vector<link::LoggedStep> log_;
  slave::SlaveOutput output_;
  Vec3 last_w_nm_;
  std::size_t done_ = 0;
  std::int64_t shift_ = 0;
};

/// `method`: the last one that the station felt by.
TouchOutcome beside_truth(const std::filesystem::path& file, slave::Slave& slave, const StepTap& tap,
                          control::Method& method) {
  const recording::RecordingReader reader(file);
  std::vector<recording::Sample> rows(reader.rows());
  reader.read_samples(0, rows);
  TouchOutcome outcome;
  if (rows.empty()) throw RunError(file.string() + ": the recording is empty");
  outcome.trace.period_s = 1e-3;
  PathTruth by_path(slave);
  LogTruth by_log(slave, tap.executed(), rows);
  const bool logged = !tap.executed().empty();
  outcome.executed = static_cast<std::int64_t>(tap.executed().size());
  std::int64_t touching = 0, clamped = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const recording::Sample& row = rows[i];
    const slave::SlaveOutput& output = logged ? by_log.at(i) : by_path.at(row);
    if (logged && !by_log.knows(row, i)) ++outcome.unexecuted;
    const double n_per_nn = 1e-9 * row.force_scale;
    const bool touches = output.contact_state == link::ContactState::kContact;
    outcome.trace.rows.push_back(
        {vec3(row.hand_force_applied_h_n), n_per_nn * output.force_w_nn, vec3(row.hand_pos_h_m), touches});
    touching += touches;
    clamped += touches && (row.limit_flags & recording::kLimitClamp) != 0;
    method = static_cast<control::Method>(row.method);
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
  const auto& pair = scenes.of(motion.scene);
  const std::unique_ptr<slave::Slave> truth = pair.make_truth();
  const control::Scaling scaling = planned_scaling(truth->limits(), {}, 1000, motion.velocity_scale);
  ChildProcess server({program("telenano-nve"), "serve", "--scene", motion.scene, "--listen", "127.0.0.1:0"});
  const std::string server_at = "127.0.0.1:" + said_port(server, " on 127.0.0.1:");
  TappedRelay relay(net::parse_address(server_at, "the server"), link);
  const support::Finished run = support::run_program({program("telenano-master"),
                                                      "run",
                                                      "--server",
                                                      relay.address(),
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
  const StepTap& tap = relay.end();
  server.signal(SIGTERM);
  server.wait(kStarts);
  if (run.exit_code != 0) throw RunError("fidelity: --real: telenano-master: " + run.err);
  try {
    result.run = beside_truth(file, *truth, tap, result.cell.method);
  } catch (const RunError& error) {
    throw RunError(fmt::format("fidelity: --real: {}: {}", stem, error.what()));
  }
  result.metrics = measure(result.run.trace, 0.1 + 1.5e-3 * link.rtt_ms);
  result.haptic = measure_haptic(result.run.trace, 0.1 + 1.5e-3 * link.rtt_ms);
  return result;
}

}  // namespace telenano::studies::fidelity

#include "tests/studies/stress/real_programs_check.h"

#include <fmt/format.h>
#include <signal.h>
#include <stdlib.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <limits>
#include <thread>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/recording/recording_reader.h"
#include "telenano/common/rt/realtime_thread.h"
#include "telenano/common/rt/steady_clock.h"
#include "tests/studies/relay/relay.h"
#include "tests/studies/stress/ending_threads.h"
#include "tests/studies/stress/stress_run.h"
#include "tests/support/child_process.h"
#include "tests/support/virtual_session.h"

namespace telenano::studies::stress {
namespace {

using device::IntendedMotion;
using support::ChildProcess;

constexpr std::chrono::seconds kStarts{30};
constexpr double kDamping = 2;                       // of the simulated device, N·s/m
constexpr double kForceMaxN = 12;                    // likewise
constexpr double kAllowanceJ = 0.010;                // E₀
constexpr double kStaleS = 0.1;                      // no force so long after the last reply
constexpr std::int64_t kOutageAtNs = 4'000'000'000;  // after the relay's start
constexpr double kHeldWindowS = 0.3;
constexpr int kAttempts = 4;

struct Case {
  const char* hand;
  control::Method method;
  double rtt_ms, jitter_ms, loss;
  double outage_ms;
  bool busy;  ///< a loop on each core beside it
};
constexpr Case kBrief[] = {{"press", control::Method::kModel, 20, 2, 0.02, 300, true},
                           {"hammer", control::Method::kKsClamp, 0, 0, 0, 0, true}};
constexpr Case kLong[] = {{"press", control::Method::kModel, 0, 0, 0, 0, false},
                          {"press", control::Method::kModel, 20, 2, 0.02, 0, true},
                          {"press", control::Method::kModel, 100, 10, 0.05, 500, true},
                          {"press", control::Method::kTank, 20, 2, 0.02, 300, true},
                          {"hammer", control::Method::kModel, 20, 2, 0.05, 0, true},
                          {"hammer", control::Method::kKsClamp, 0, 0, 0, 300, true},
                          {"hammer", control::Method::kTank, 100, 10, 0.02, 500, true},
                          {"scrub", control::Method::kModel, 20, 2, 0.02, 300, true},
                          {"scrub", control::Method::kKsClamp, 0, 0, 0.05, 0, true},
                          {"scrub", control::Method::kTank, 20, 5, 0.1, 0, true}};

/// Heights over the surface in nm; the tip waits at 20.
std::vector<IntendedMotion::Waypoint> motion(const std::string& hand, double seconds) {
  std::vector<IntendedMotion::Waypoint> path{{0, {0, 0, 20}}, {0.6, {0, 0, 20}}, {1.2, {0, 0, -8}}};
  if (hand == "hammer") {
    for (double t = 1.3; t < seconds - 0.7; t += 0.2) {
      path.push_back({t, {0, 0, 12}});
      path.push_back({t + 0.1, {0, 0, -20}});
    }
  }
  if (hand == "scrub") {
    for (double t = 1.4; t < seconds - 0.7; t += 0.4) {
      path.push_back({t, {15, 0, -8}});
      path.push_back({t + 0.2, {-15, 0, -8}});
    }
  }
  path.push_back({seconds - 0.6, {0, 0, hand == "press" ? -8.0 : 12.0}});
  path.push_back({seconds - 0.2, {0, 0, 20}});
  path.push_back({seconds, {0, 0, 20}});
  return path;
}

/// What a session is like, whoever drives it; from the rows of its recording.
struct Metrics {
  double held_n = 0;        ///< the largest mean of the force over kHeldWindowS
  double rms_n = 0;         ///< of the force over all rows
  double peak_n = 0;        ///< of the force
  double extracted_mj = 0;  ///< most that the hand got, less what the device's damping took
  double rtt_ms = 0;        ///< median
  double silent = 0;        ///< part of the rows whose force is old, or that wait for replies
  double pause_ms = 0;      ///< the longest that a tick came late
  std::string broken;       ///< invariants
};

Vec3 vec3(const recording::Xyz& v) {
  return {v[0], v[1], v[2]};
}

Metrics measure(const std::vector<recording::Sample>& rows, double force_limit_n) {
  Metrics m;
  double sum2 = 0, given_j = 0, lost_j = 0, window_n = 0, last_news_s = 0;
  std::size_t from = 0;
  std::int64_t reply = -1;
  std::vector<double> rtts;
  const auto breaks = [&m](const char* what) {
    if (m.broken.find(what) == std::string::npos)
      m.broken += (m.broken.empty() ? "" : "+") + std::string(what);
  };
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const recording::Sample& row = rows[k];
    const Vec3 force = vec3(row.hand_force_applied_h_n);
    const double norm_n = force.norm();
    if (!is_finite(force) || !is_finite(vec3(row.hand_pos_h_m))) breaks("finite");
    if (norm_n > force_limit_n * (1 + 1e-9)) breaks("force");
    m.peak_n = std::max(m.peak_n, norm_n);
    sum2 += norm_n * norm_n;
    window_n += norm_n;
    while (row.time_s - rows[from].time_s > kHeldWindowS)
      window_n -= vec3(rows[from++].hand_force_applied_h_n).norm();
    if (row.time_s > kHeldWindowS)
      m.held_n = std::max(m.held_n, window_n / static_cast<double>(k - from + 1));
    if (k > 0) {
      const Vec3 moved_m = vec3(row.hand_pos_h_m) - vec3(rows[k - 1].hand_pos_h_m);
      const double dt_s = row.time_s - rows[k - 1].time_s;
      given_j += vec3(rows[k - 1].hand_force_applied_h_n).dot(moved_m);
      lost_j += kDamping * moved_m.squaredNorm() / dt_s;
      m.extracted_mj = std::max(m.extracted_mj, 1e3 * (given_j - lost_j));
      m.pause_ms = std::max(m.pause_ms, 1e3 * dt_s - 1);
      if (row.tick != rows[k - 1].tick + 1) breaks("record");
      if (row.energy_in_j < rows[k - 1].energy_in_j || row.energy_out_j < rows[k - 1].energy_out_j)
        breaks("sums");
    }
    if (row.reply_sequence != reply) {
      reply = row.reply_sequence;
      last_news_s = row.time_s;
    } else if (row.time_s - last_news_s > kStaleS + 2e-3 && norm_n > 0) {
      breaks("stale");
    }
    if (row.rtt_us > 0) rtts.push_back(1e-3 * row.rtt_us);
    m.silent += (row.limit_flags & recording::kLimitStale) != 0 ||
                row.station_mode == static_cast<std::uint32_t>(station::Mode::kHeld);
  }
  if (rows.empty()) return m;
  m.rms_n = std::sqrt(sum2 / static_cast<double>(rows.size()));
  m.silent /= static_cast<double>(rows.size());
  if (!rtts.empty()) {
    std::nth_element(rtts.begin(), rtts.begin() + static_cast<std::ptrdiff_t>(rtts.size() / 2), rtts.end());
    m.rtt_ms = rtts[rtts.size() / 2];
  }
  return m;
}

class Folder {
 public:
  Folder() {
    std::string name = (std::filesystem::temp_directory_path() / "telenano_real_XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) throw RunError("stress: " + name + " cannot be created");
    path_ = name;
  }
  ~Folder() {
    std::error_code error;
    std::filesystem::remove_all(path_, error);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  std::string file(const std::string& name) const { return (path_ / name).string(); }

 private:
  std::filesystem::path path_;
};

std::string program(const std::string& name) {
  const std::filesystem::path here = std::filesystem::read_symlink("/proc/self/exe").parent_path();
  const std::filesystem::path path = here / name;
  if (!std::filesystem::exists(path))
    throw UserError("stress: --realtime: " + path.string() + " is missing; build " + name);
  return path.string();
}

struct Setting {
  Case what;
  double seconds;
  std::shared_ptr<const scene::Scene> scene;
  std::vector<IntendedMotion::Waypoint> script;
  double force_scale = 0;
};

/// When the hand's motion begins, by the recording's time.
double engaged_s(const recording::Sample& row) {
  return row.station_mode == static_cast<std::uint32_t>(station::Mode::kEngaged) ? row.time_s : -1;
}

/// `outage_s`: when the outage began, from the beginning of the hand's motion on.
std::vector<recording::Sample> in_real_time(const Setting& s, const Folder& folder, double& outage_s) {
  std::ofstream script(folder.file("hand.csv"));
  script << "t_s,x_nm,y_nm,z_nm\n";
  for (const auto& w : s.script)
    script << fmt::format("{},{},{},{}\n", w.time_s, w.pos_nm.x(), w.pos_nm.y(), w.pos_nm.z());
  if (!script.flush()) throw RunError("stress: the script cannot be written");
  const std::string keys = folder.file("keys.toml"), key = folder.file("hand.key"),
                    file = folder.file("run.h5");
  if (!std::filesystem::exists(key)) {
    const auto made = support::run_program({program("telenano-nve"), "keys", "new", "hand", "--rights",
                                            "operate", "--keys", keys, "--out", key});
    if (made.exit_code != 0) throw RunError("stress: --realtime: telenano-nve keys: " + made.err);
  }
  ChildProcess server({program("telenano-nve"), "serve", "--scene", "flat_silicon_oxide", "--rt-priority",
                       "70", "--listen", "127.0.0.1:0", "--keys", keys});
  const std::string before = " on 127.0.0.1:";
  if (!server.wait_for_err(before, kStarts))
    throw RunError("stress: --realtime: telenano-nve: " + server.err());
  const std::string said = server.err();
  RelayConfig config;
  config.listen = net::parse_address("127.0.0.1:0", "the relay");
  config.to = net::parse_address(
      "127.0.0.1:" + std::to_string(std::atoi(said.c_str() + said.find(before) + before.size())),
      "the server");
  for (net::ImpairmentConfig* way : {&config.to_server, &config.to_client}) {
    way->delay_ns = std::llround(0.5e6 * s.what.rtt_ms);
    way->jitter_ns = std::llround(1e6 * s.what.jitter_ms);
    way->loss = s.what.loss;
    if (s.what.outage_ms > 0) way->outages.push_back({kOutageAtNs, std::llround(1e6 * s.what.outage_ms)});
  }
  const rt::SteadyClock clock;
  Relay relay(config, clock);
  const std::int64_t relay_ns = clock.now_ns();
  EndingThreads threads;
  threads.start([&] {
    rt::RealtimeConfig before_the_loops;  // where the system permits it
    before_the_loops.priority = 60;
    before_the_loops.lock_memory = false;
    rt::enter_realtime(before_the_loops);
    while (!threads.stop) relay.step(20'000'000);
  });
  if (s.what.busy) {
    for (unsigned i = 0; i < std::max(1u, std::thread::hardware_concurrency()); ++i)
      threads.start([&] {
        volatile std::uint64_t work = 0;
        while (!threads.stop) work = work + 1;
      });
  }
  const auto run = support::run_program({program("telenano-master"),
                                         "run",
                                         "--server",
                                         net::to_string(relay.local()),
                                         "--key",
                                         key,
                                         "--device",
                                         "sim",
                                         "--task",
                                         "script",
                                         "--script",
                                         folder.file("hand.csv"),
                                         "--method",
                                         std::string(control::method_name(s.what.method)),
                                         "--velocity-scale",
                                         "1e-6",
                                         "--force-scale",
                                         fmt::format("{}", s.force_scale),
                                         "--allow-unsafe-scaling",
                                         "--record",
                                         file,
                                         "--overwrite",
                                         "--no-view"},
                                        {}, std::chrono::seconds(60));
  threads.stop = true;
  server.signal(SIGTERM);
  server.wait(kStarts);
  if (run.exit_code != 0) throw RunError("stress: --realtime: telenano-master: " + run.err);
  const recording::RecordingReader reader(file);
  std::vector<recording::Sample> rows(reader.rows());
  reader.read_samples(0, rows);
  if (rows.empty()) throw RunError("stress: --realtime: the recording is empty");
  const auto engaged =
      std::find_if(rows.begin(), rows.end(), [](const auto& row) { return engaged_s(row) >= 0; });
  if (engaged == rows.end()) throw RunError("stress: --realtime: the station never engaged");
  outage_s = 1e-9 * static_cast<double>(relay_ns + kOutageAtNs - engaged->now_ns);
  return rows;
}

std::vector<recording::Sample> in_virtual_time(const Setting& s, double outage_s) {
  support::VirtualSessionConfig config;
  config.scene = s.scene;
  config.station.method = s.what.method;
  config.station.scaling = {1e-6, s.force_scale};
  config.station.allow_unsafe_scaling = true;
  config.task = device::Task::kScript;
  config.script = s.script;
  for (net::SimPath* path : {&config.to_server, &config.to_station}) {
    path->delay_ns = std::llround(0.5e6 * s.what.rtt_ms);
    path->jitter_ns = std::llround(1e6 * s.what.jitter_ms);
  }
  support::VirtualSession session(config);
  std::vector<recording::Sample> rows;
  double began_s = -1;
  session.run(std::llround(1e3 * (s.seconds + 20)), [&](const recording::Sample& row) {
    rows.push_back(row);
    if (began_s < 0) began_s = engaged_s(row);
    const double since_s = began_s < 0 ? -1 : row.time_s - began_s;
    const bool out =
        s.what.outage_ms > 0 && since_s >= outage_s && since_s < outage_s + 1e-3 * s.what.outage_ms;
    for (net::SimPath* path : {&session.link().path_a_to_b(), &session.link().path_b_to_a()}) {
      path->loss = s.what.loss;
      path->down = out;
    }
  });
  return rows;
}

struct Line {
  const char* metric;
  double in_virtual, in_real, bound;
  bool agrees() const noexcept { return std::fabs(in_real - in_virtual) <= bound; }
};

}  // namespace

int check_real_programs(const std::string& scene_folder, bool brief) {
  const Scenes scenes(scene_folder, {SceneKind::kOxide});
  const Folder folder;
  bool all = true;
  std::printf("programs,hand,method,rtt_ms,jitter_ms,loss,outage_ms,busy,metric,virtual,real,bound,agrees\n");
  std::vector<Case> cases(std::begin(kLong), std::end(kLong));
  if (brief) cases.assign(std::begin(kBrief), std::end(kBrief));
  for (const Case& what : cases) {
    Setting s{what, brief ? 4.0 : 8.0, scenes.file(SceneKind::kOxide), {}, 0};
    s.script = motion(what.hand, s.seconds);
    RunSpec spec;
    spec.method = what.method;
    spec.scene = SceneKind::kOxide;
    s.force_scale = planned_force_scale(spec, scenes.make(SceneKind::kOxide, 20)->limits());
    const double limit_n = station::StationConfig{}.force_safety * kForceMaxN;
    // After an outage the hand's place is a new one: where in its swing a hammering hand was when the link came
    // back decides how deep it goes from then on, and a tick makes a difference. Its forces are told of, and held
    // to what is promised alone.
    const bool compares_force = std::string(what.hand) != "hammer" || what.outage_ms == 0;
    Metrics v, r;
    std::vector<Line> lines;
    bool promised = true, agrees = false;
    double promised_mj = 0;
    int attempt = 0;
    // A machine that keeps relay or server waiting is a bad link that the virtual run does not have: again then.
    // What is promised holds on any machine, in each attempt.
    for (; attempt < kAttempts && promised && !agrees; ++attempt) {
      double outage_s = 0;
      const auto rows = in_real_time(s, folder, outage_s);
      r = measure(rows, limit_n);
      v = measure(in_virtual_time(s, outage_s), limit_n);
      const double paused = 1e-3 * r.pause_ms / s.seconds;
      const double force = compares_force ? 1 : std::numeric_limits<double>::infinity();
      lines = {{"held_n", v.held_n, r.held_n, force * 0.05 * v.held_n},
               {"rms_n", v.rms_n, r.rms_n, force * (0.15 * v.rms_n + paused * v.peak_n)},
               {"peak_n", v.peak_n, r.peak_n, force * 0.15 * v.peak_n},
               {"extracted_mj", v.extracted_mj, r.extracted_mj, force * 2},
               {"rtt_ms", v.rtt_ms, r.rtt_ms, what.busy ? 6.0 : 3.0},
               {"silent_part", v.silent, r.silent, (what.busy ? 0.15 : 0.05) + 4 * paused}};
      agrees = std::all_of(lines.begin(), lines.end(), [](const Line& l) { return l.agrees(); });
      // A late tick may overdraw once by |F|·v·(k − 1)·T, v the fastest that a hand may be.
      promised_mj =
          1e3 * (what.method == control::Method::kTank ? 2 : 1) * kAllowanceJ + r.peak_n * 0.5 * r.pause_ms;
      promised = r.extracted_mj <= promised_mj && v.extracted_mj <= promised_mj && r.broken.empty() &&
                 v.broken.empty();
    }
    const auto tell = [&](const char* metric, const std::string& values, const char* word) {
      std::printf("stress,%s,%s,%g,%g,%g,%g,%d,%s,%s,%s\n", what.hand,
                  std::string(control::method_name(what.method)).c_str(), what.rtt_ms, what.jitter_ms,
                  what.loss, what.outage_ms, what.busy ? 1 : 0, metric, values.c_str(), word);
    };
    const auto yes = [](bool good) { return good ? "yes" : "no"; };
    for (const Line& line : lines)
      tell(line.metric, fmt::format("{:.4g},{:.4g},{:.3g}", line.in_virtual, line.in_real, line.bound),
           std::isfinite(line.bound) ? yes(line.agrees()) : "not compared");
    tell("promise_mj", fmt::format("{:.4g},{:.4g},{:.3g}", v.extracted_mj, r.extracted_mj, promised_mj),
         yes(std::max(v.extracted_mj, r.extracted_mj) <= promised_mj));
    tell(
        "invariants",
        fmt::format("{},{},none", v.broken.empty() ? "none" : v.broken, r.broken.empty() ? "none" : r.broken),
        yes(v.broken.empty() && r.broken.empty()));
    all = all && promised && agrees;
    std::fprintf(stderr, "stress: %s, %s: attempt %d; the station waited for at most %.1f ms for its tick\n",
                 what.hand, std::string(control::method_name(what.method)).c_str(), attempt, r.pause_ms);
    std::fflush(stdout);
  }
  return all ? 0 : 1;
}

}  // namespace telenano::studies::stress

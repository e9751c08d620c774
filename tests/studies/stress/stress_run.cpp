#include "tests/studies/stress/stress_run.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "telenano/common/base/error.h"
#include "telenano/common/base/random.h"
#include "telenano/common/link/session_table.h"
#include "telenano/master/station/station.h"
#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/studies/stress/command_watch.h"
#include "tests/studies/stress/fault_injection.h"
#include "tests/studies/stress/felt_limits.h"
#include "tests/studies/stress/hands.h"
#include "tests/studies/stress/invariants.h"
#include "tests/studies/stress/lead_watch.h"
#include "tests/studies/stress/mutants.h"
#include "tests/studies/stress/operator_acts.h"
#include "tests/studies/stress/record_watch.h"
#include "tests/studies/stress/reply_watch.h"
#include "tests/studies/stress/search.h"
#include "tests/studies/stress/watched_slave.h"
#include "tests/studies/stress/wrong_twin.h"
#include "tests/studies/stress/wrong_wire.h"
#include "tests/support/virtual_session.h"
#include "tests/support/wall_slave.h"

namespace telenano::studies::stress {
namespace {

constexpr double kMargin = 0.99;  // of the planned scale within its bound
constexpr double kMovedM = 2e-5;  // a target at rest; a fifth of what is asked of the tip (drift_limit_mm)
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kForceMaxN = 12;
constexpr double kShownN = 0.75 * kForceMaxN;  // below the station's own limit
constexpr double kStopS = 0.02;  // of station and server, until a stop that has come does something
constexpr double kSilenceS = 1e-9 * link::SessionTableConfig{}.timeout_ns;
constexpr double kWallHeightNm = 5;  // of the tip over the wall at the start

std::int64_t nanoseconds(double seconds) {
  return std::llround(1e9 * seconds);
}

Vec3 vec3(const recording::Xyz& v) {
  return {v[0], v[1], v[2]};
}

bool is_engaged(const recording::Sample& row) noexcept {
  return row.station_mode == static_cast<std::uint32_t>(station::Mode::kEngaged);
}

/// Nothing waits for longer than this to be shown.
double playout_longest_ms(const RunSpec& spec) {
  using Mode = link::PlayoutConfig::Mode;
  if (spec.playout == Mode::kNewest) return 0;
  return spec.playout == Mode::kConstant ? spec.playout_ms
                                         : std::max({500.0, 2 * spec.rtt_ms, spec.playout_ms});
}

/// The same sample felt without link and delay: what the hand should have felt at the tip's commanded place.
class LocalTouch {
 public:
  LocalTouch(const RunSpec& spec, const Scenes& scenes, double force_scale)
      : judged_(felt_limits(spec).has_value()),
        level_(is_task(spec.hand) && spec.scene != SceneKind::kScan),
        acts_(spec.act != Act::kNone),
        slave_(judged_ || level_ ? scenes.make(spec.scene, kWallHeightNm) : nullptr),
        nve_(dynamic_cast<const slave::NveSlave*>(slave_.get())),
        n_per_nn_(1e-9 * force_scale) {
    if (spec.method == control::Method::kTwin) companding_.gain = spec.compand;
    trace_.period_s = 1 / spec.rate_hz;
    if (judged_)
      trace_.rows.reserve(static_cast<std::size_t>((spec.seconds + 6e-3 * spec.rtt_ms + 3) * spec.rate_hz));
  }
  /// `force_scale`: that the operator has chosen. `settled`: what the operator did last has long been felt.
  void add(const recording::Sample& row, double dt_s, double force_scale, bool settled) {
    if (!slave_) return;
    n_per_nn_ = 1e-9 * force_scale;
    slave::SlaveInput input;
    input.follow = is_engaged(row);
    input.tip_target_pos_w_nm = Vec3(row.tip_target_w_nm[0], row.tip_target_w_nm[1], row.tip_target_w_nm[2]);
    slave_->step(input, dt_s, output_);
    const bool touches = output_.contact_state == link::ContactState::kContact;
    if (judged_)
      trace_.rows.push_back({vec3(row.hand_force_applied_h_n),
                             n_per_nn_ * companded(touches) * output_.force_w_nn, vec3(row.hand_pos_h_m),
                             touches});
    if (input.follow && touches) {
      const Vec3 ideal_h_n = n_per_nn_ * output_.force_w_nn;
      for (std::size_t i = 0; i < 2; ++i) {
        const double across_n = ideal_h_n[static_cast<int>(i)];
        lateral_both_ += row.hand_force_applied_h_n[i] * across_n;
        lateral_ideal2_ += across_n * across_n;
      }
    }
    if (!level_) return;
    most_nn_ = std::max(most_nn_, output_.force_w_nn.norm());
    if (!input.follow || !touches || !settled) return;
    if (acts_ && n_per_nn_ * output_.force_w_nn.norm() > kShownN) return;  // more than the device may show
    const double ideal_n = n_per_nn_ * output_.force_w_nn.z(), shown_n = row.hand_force_applied_h_n[2];
    error2_ += (shown_n - ideal_n) * (shown_n - ideal_n);
    both_ += shown_n * ideal_n;
    ideal2_ += ideal_n * ideal_n;
    ++count_;
  }
  /// ψ′ as it is written down, of a slave that has not been told of it.
  double companded(bool touches) const noexcept {
    if (touches || nve_ == nullptr || !(nve_->stored_aj() < 0)) return 1;
    const double u = -nve_->stored_aj() / companding_.energy_aj;
    return 1 + (companding_.gain - 1) / ((1 + u) * (1 + u));
  }
  fidelity::FeltMetrics felt(double lag_max_s) const { return fidelity::measure(trace_, lag_max_s); }
  double rms_n() const noexcept {
    return count_ > 0 ? std::sqrt(error2_ / static_cast<double>(count_)) : kNan;
  }
  double ratio() const noexcept { return ideal2_ > 0 ? both_ / ideal2_ : kNan; }
  /// Of what acts along the ground, in both directions.
  double lateral_ratio() const noexcept {
    return lateral_ideal2_ > 0 ? lateral_both_ / lateral_ideal2_ : kNan;
  }
  double over_force(double most_nn) const noexcept { return most_nn_ > 0 ? most_nn / most_nn_ : kNan; }

 private:
  bool judged_;  ///< felt_limits() asks for the whole trace
  bool level_;   ///< sums of the normal force mean something
  bool acts_;    ///< the operator does, and not only the hand
  std::unique_ptr<slave::Slave> slave_;
  const slave::NveSlave* nve_;  ///< of slave_; null: another kind
  control::CompandingConfig companding_;
  slave::SlaveOutput output_;
  fidelity::TouchTrace trace_;
  double n_per_nn_;
  double lateral_both_ = 0, lateral_ideal2_ = 0;
  double error2_ = 0, both_ = 0, ideal2_ = 0, most_nn_ = 0;
  std::int64_t count_ = 0;
};

class Hash {
 public:
  void add(double value) noexcept {
    const auto bits = std::bit_cast<std::uint64_t>(value);
    for (int i = 0; i < 64; i += 32) hash_ = (hash_ ^ ((bits >> i) & 0xffffffffu)) * 0x100000001b3ull;
  }
  std::uint64_t value() const noexcept { return hash_; }

 private:
  std::uint64_t hash_ = 0xcbf29ce484222325ull;
};

bool shared_tip(const RunSpec& spec) noexcept {
  return spec.act == Act::kTakeOver;
}

/// Moved by this station's commands alone, from the run's beginning to its end.
bool one_server(const RunSpec& spec) noexcept {
  return spec.restart == Restart::kNever && !shared_tip(spec);
}

/// With a log of steps every command is answered; of a shared tip others' steps are not this session's.
bool leaves_replies_out(const RunSpec& spec) noexcept {
  return spec.method != control::Method::kTwin && !shared_tip(spec);
}

/// As the station asks for it.
link::ReplyDeadband reply_deadband(const RunSpec& spec, double force_scale) noexcept {
  const double floor_pn = std::min(1e3 * spec.reply_n / (1e-9 * force_scale), 1e9);
  return {static_cast<std::uint32_t>(floor_pn), static_cast<std::uint32_t>(spec.reply_permille)};
}

support::VirtualSessionConfig session_config(const RunSpec& spec, const Scenes& scenes,
                                             const std::shared_ptr<SlaveWatch>& watch,
                                             const std::shared_ptr<ReplyWatch>& replies, double force_scale) {
  support::VirtualSessionConfig session;
  session.scene = scenes.file(spec.scene);
  const double rise_nm_s = session.scene ? session.scene->limits.retract_speed_nm_s
                                         : support::WallSlaveConfig{}.retract_speed_nm_s;
  session.make_slave = [&scenes, kind = spec.scene, mutant = spec.mutant, watch, rise_nm_s] {
    return std::make_unique<WatchedSlave>(scenes.make(kind, kWallHeightNm), watch, mutant, rise_nm_s);
  };
  if (make_mutant_method(spec)) session.make_method = [spec] { return make_mutant_method(spec); };
  const bool wrong_gate = WrongWire::is_gate(spec.mutant);
  std::shared_ptr<WrongWire> wrong;
  if (WrongWire::concerns(spec.mutant))
    wrong = std::make_shared<WrongWire>(spec.mutant, reply_deadband(spec, force_scale));
  if (wrong || replies->watches())
    session.lie = [wrong, replies, watch](std::span<std::uint8_t> out, std::size_t size) {
      if (wrong) size = (*wrong)(out, size);
      if (size > 0 && replies->watches()) replies->leaves(out.first(size), *watch);
      return size;
    };
  session.station.method = spec.method;
  // Of a shared tip there is no twin.
  if (shared_tip(spec)) session.share = server::Share::kOneTip;
  session.twin = spec.method == control::Method::kTwin && session.scene != nullptr && !shared_tip(spec);
  if (session.twin)
    session.make_twin = [&scenes, kind = spec.scene,
                         mutant = spec.mutant]() -> std::unique_ptr<control::LocalSlave> {
      auto twin = scenes.make_twin(kind);
      if (!WrongTwin::concerns(mutant)) return twin;
      return std::make_unique<WrongTwin>(std::move(twin), mutant);
    };
  session.station.rate_hz = spec.rate_hz;
  session.station.scaling = {spec.velocity_scale, force_scale};
  session.station.allow_unsafe_scaling = spec.scale > 1 || spec.mutant == Mutant::kStationTooStiff;
  session.station.companding.gain = spec.compand;
  session.server_drift_ppm = spec.drift_ppm;
  session.seed = spec.seed;
  session.redundancy = static_cast<std::size_t>(spec.redundancy);
  link::PlayoutConfig& playout = session.link_options.playout;
  playout.mode = spec.playout;
  playout.rate_hz = spec.rate_hz;
  playout.delay_ns = nanoseconds(1e-3 * spec.playout_ms);
  playout.delay_max_ns = nanoseconds(1e-3 * playout_longest_ms(spec));
  session.link_options.gate.deadband_nm = spec.deadband_nm * (spec.mutant == Mutant::kCommandCoarse ? 3 : 1);
  if (spec.mutant == Mutant::kCommandLate) session.link_options.gate.heartbeat_ns *= 5;
  if (spec.mutant == Mutant::kStationNoTrip)
    session.station.guaranteed_velocity_m_s = session.station.trip_velocity_m_s = 5;
  session.link_options.gate.deadband_n = spec.deadband_n;
  session.link_options.reply_deadband.permille = wrong_gate ? 0 : spec.reply_permille;
  session.link_options.reply_deadband.floor_n = spec.reply_n;
  session.to_server.delay_ns = session.to_station.delay_ns = nanoseconds(0.5e-3 * spec.rtt_ms);
  // What is on the way, with jitter of some standard deviations, duplicates and replies.
  const double on_the_way = spec.rate_hz * (1e-3 * spec.rtt_ms * (1 + 4 * spec.jitter) + 0.03);
  session.link_capacity = std::max<std::size_t>(64, static_cast<std::size_t>(2 * on_the_way));
  return session;
}

/// What the invariants know of this run: what its method promises there, and what of a link is to be expected of them.
InvariantWatch::Limits invariant_limits(const RunSpec& spec, const support::VirtualSessionConfig& config,
                                        support::VirtualSession& session, const slave::SlaveLimits& limits,
                                        const FaultInjection& faults, double force_scale) {
  const station::StationConfig& station = session.station().config();
  InvariantWatch::Limits what;
  // Without a scene there is no twin, and the station falls back.
  what.method = spec.method == control::Method::kTwin && !config.twin ? control::Method::kModel : spec.method;
  what.allowance_j = station.allowance_j;
  what.velocity_max_m_s = station.guaranteed_velocity_m_s;
  what.trip_m_s = station::StationConfig{}.trip_velocity_m_s;
  what.period_s = session.period_s();
  what.force_limit_n = station.force_safety * kForceMaxN;
  what.slew_n_s = station.slew_n_s;
  what.stale_zero_s = station.stale_zero_s;
  if (!config.twin && spec.playout == link::PlayoutConfig::Mode::kNewest)
    what.stale_hold_s = station.stale_hold_s;
  what.store_j =
      (what.method == control::Method::kTank || spec.act == Act::kMethod ? 2 : 1) * station.store_max_j;
  if (config.twin) {
    // A twin needs no reply to be right, for as long as the slave itself would go on following. Its well is
    // the scene's, once in the station's life.
    const double hold_s =
        std::min(station::TwinRunConfig{}.silence_s, 0.5e-3 * config.scene->session_timeout_ms);
    what.stale_zero_s += std::max(0.0, hold_s - station.stale_hold_s);
    control::CompandingConfig companding = station.companding;
    companding.gain = OperatorActs::most_gain(spec);
    const double well_j = station.scaling.hand_energy_j(limits.well_aj + companding.most_aj()) *
                          OperatorActs::most_energy_scale(spec.act);
    what.well_most_j = std::min(well_j, station.well_max_j);
  }
  what.ramp_s = station.engage_ramp_s;
  what.tip_limit_nn = limits.force_max_nn;
  const double impedance = force_scale * spec.velocity_scale * OperatorActs::least_impedance(spec.act);
  what.damper_cap_n_s_m =
      std::max(0.0, spec.damping_n_s_m - 0.5 * impedance * limits.coupling_stiffness_n_m * what.period_s -
                        impedance * std::fabs(limits.coupling_damping_n_s_m));
  // What the slave's joules are worth changes with the scale; the two sides then have no common account.
  what.balance = spec.method == control::Method::kTank && spec.act == Act::kNone;
  what.hand_j_per_aj = station.scaling.hand_energy_j(1) * OperatorActs::most_energy_scale(spec.act);
  what.too_long = !config.twin && spec.act == Act::kNone && spec.jitter == 0 &&
                  spec.restart == Restart::kNever &&
                  1e-3 * spec.rtt_ms > 1.02 * station.age_most_s(what.method);
  if (spec.act == Act::kMethod) what.method = control::Method::kTank;  // the most that one of them promises
  what.waits_s = 1e-3 * playout_longest_ms(spec);
  const double way_s = 0.5e-3 * spec.rtt_ms;
  const bool delivers = one_server(spec) && faults.clean_besides() && spec.jitter == 0 &&
                        spec.outage_ms == 0 && spec.leap_ms == 0;
  // Of two stops on the way, one may be held up for as long as what is out of order.
  if (delivers) what.stop_s = way_s + kStopS + (spec.reorder > 0 ? std::max(0.5 * way_s, 0.002) : 0);
  if (one_server(spec))
    what.silence_s = (config.scene ? 1e-3 * config.scene->session_timeout_ms : kSilenceS) + 3 * way_s + 0.1;
  // Beyond the age that a method's force may have the station holds: so it should. Jitter adds to it.
  const bool shows = 1e-3 * spec.rtt_ms * (1 + 2 * spec.jitter) < station.age_most_s(what.method);
  if (faults.clean_besides() && shows && spec.act == Act::kNone)
    what.recover_s = 3 + 1e-2 * spec.rtt_ms + what.waits_s;
  return what;
}

LeadWatch::Limits lead_limits(const station::StationConfig& station, double period_s) {
  LeadWatch::Limits limits;
  limits.period_s = period_s;
  limits.fade_s = station.stale_zero_s - station.stale_hold_s;
  limits.ramp_s = station.engage_ramp_s;
  limits.damper_m_s = station.guaranteed_velocity_m_s;
  return limits;
}

/// `hand_h_m` and `buttons`: when the tick began. `waits`: replies do, until they are shown. `steady`: between two ticks the
/// force changes by what the hand and the operator do, and by nothing that waited or was late, or shown by the encoder's steps.
LeadWatch::Tick lead_tick(const recording::Sample& row, support::VirtualSession& session,
                          const OperatorActs& acts, const Vec3& hand_h_m, std::uint32_t buttons, int periods,
                          const SlaveWatch& slave, bool waits, bool steady) {
  const link::Welcome& welcome = session.client().welcome();
  LeadWatch::Tick tick;
  tick.time_s = row.time_s;
  tick.periods = periods;
  tick.hand_h_m = hand_h_m;
  tick.target_w_nm = vec3(row.tip_target_w_nm);
  tick.force_h_n = vec3(row.hand_force_applied_h_n);
  tick.rendered_h_n = vec3(row.hand_force_rendered_h_n);
  tick.damper_n_s_m = row.damper_n_s_m;
  tick.velocity_scale = acts.scaling().velocity;
  tick.rescaled = acts.rescaled_now();
  // Of a shared tip a reply that waits to be shown says where it was put.
  tick.put_anywhere = (welcome.feature_bits & link::kFeatureSharing) != 0 && waits;
  tick.engaged = is_engaged(row);
  // Over a longer way a tip that was up is engaged before that is known, and has moved on when it is.
  constexpr double kKnownS = 0.1;
  tick.retracted = (row.fault_bits & link::kFaultRetracted) != 0 && 1e-6 * row.rtt_us < kKnownS && !waits;
  tick.observes = (welcome.feature_bits & link::kFeatureSharing) != 0 && !waits &&
                  session.client().has_reply() && session.client().reply().tip.hold == 0;
  // Methods that hold no positions go on to where they have lagged, for whoever has the tip.
  const bool holds_positions = row.method != static_cast<std::uint32_t>(control::Method::kWave) &&
                               row.method != static_cast<std::uint32_t>(control::Method::kTdpa);
  tick.another_has_tip = acts.rival_has_tip() && holds_positions;
  tick.withdraws = slave.retracted || slave.rises;
  tick.slave_z_w_nm = slave.commanded_w_nm.z();
  tick.clutch = (buttons & device::kButtonClutch) != 0;
  tick.stopped = acts.stopped();
  tick.acted = acts.changed_now() && steady;
  tick.sessions = static_cast<std::int64_t>(session.client().sessions());
  tick.logs = (welcome.feature_bits & link::kFeatureStepLog) != 0;
  tick.begins_w_nm = welcome.start_pos_w_nm;
  tick.lowest_w_nm = welcome.workspace_min_w_nm;
  tick.highest_w_nm = welcome.workspace_max_w_nm;
  tick.tip_w_nm = vec3(row.tip_pos_w_nm);
  tick.held_w_nm = session.client().reply().tip.pos_w_nm;
  return tick;
}

CommandWatch::Limits command_limits(const RunSpec& spec) {
  CommandWatch::Limits limits;
  limits.deadband_nm = spec.deadband_nm;
  limits.deadband_n = spec.deadband_n;
  limits.heartbeat_s = 1e-9 * static_cast<double>(link::SendGateConfig{}.heartbeat_ns);
  using control::Method;
  const bool as_it_is = spec.method == Method::kNone || spec.method == Method::kKs ||
                        spec.method == Method::kKsClamp || spec.method == Method::kModel;
  limits.keeps_targets = as_it_is && spec.act != Act::kMethod && !shared_tip(spec);
  return limits;
}

CommandWatch::Tick command_tick(const recording::Sample& row, support::VirtualSession& session) {
  CommandWatch::Tick tick;
  tick.time_s = row.time_s;
  tick.sessions = static_cast<std::int64_t>(session.client().sessions());
  tick.has_session = session.client().has_session();
  tick.sent = row.sent_ns != 0;
  tick.twin = row.method == static_cast<std::uint32_t>(control::Method::kTwin);
  tick.target_w_nm = vec3(row.tip_target_w_nm);
  tick.force_h_n = vec3(row.hand_force_commanded_h_n);
  return tick;
}

}  // namespace

double planned_force_scale(const RunSpec& spec, const slave::SlaveLimits& limits) {
  control::ScalingPlant plant;
  plant.device_damping_n_s_m = spec.damping_n_s_m;
  plant.coupling_stiffness_n_m = limits.coupling_stiffness_n_m;
  plant.coupling_damping_n_s_m = limits.coupling_damping_n_s_m;
  plant.period_s = 1 / spec.rate_hz;
  plant.delay_samples = 1;
  const double passive = control::exact_impedance_bound(plant) / spec.velocity_scale;
  const double device = control::device_force_scale_bound(station::StationConfig{}.force_safety, kForceMaxN,
                                                          limits.force_max_nn);
  return kMargin * std::min(passive, device);
}

Outcome run(const RunSpec& given, const Scenes& scenes, const RunExtras& extras) {
  if (given.hand == HandKind::kClimbWhite || given.hand == HandKind::kClimbSlow) {
    const Climbed climbed = climb(given, scenes);
    Outcome outcome = run(climbed.spec, scenes, extras);
    outcome.ticks += climbed.ticks;
    return outcome;
  }
  RunSpec spec = given;
  const auto watch = std::make_shared<SlaveWatch>();
  const slave::SlaveLimits limits = scenes.make(spec.scene, kWallHeightNm)->limits();
  const double force_scale = spec.scale * planned_force_scale(spec, limits);
  Ground ground;
  ground.metres_per_nm = 1e-9 / spec.velocity_scale;
  ground.wall_m = -(limits.start_pos_w_nm.z() - limits.surface_z_w_nm) * ground.metres_per_nm;
  const std::shared_ptr<StressHand> hand = make_hand(spec, ground);
  const auto ticks = std::llround((spec.seconds + 6e-3 * spec.rtt_ms) * spec.rate_hz);
  if (extras.path_m != nullptr) hand->keep_path(static_cast<std::size_t>(ticks));

  const auto replies =
      std::make_shared<ReplyWatch>(leaves_replies_out(spec) ? spec.reply_permille : 0, spec.reply_n);
  support::VirtualSessionConfig config = session_config(spec, scenes, watch, replies, force_scale);
  config.hand = with_mutant(hand, spec.mutant);
  if (extras.make_method) config.make_method = extras.make_method;
  support::VirtualSession session(config);
  FaultInjection faults(spec, session);
  OperatorActs acts(spec, session, *hand);

  const InvariantWatch::Limits what = invariant_limits(spec, config, session, limits, faults, force_scale);
  InvariantWatch invariants(what);
  RecordWatch record(session.period_s(), spec.quantum_m);
  watch->keeps_said = one_server(spec);
  WrongRecorder recorder(spec.mutant);

  LeadWatch lead(lead_limits(session.station().config(), session.period_s()));
  CommandWatch commands(command_limits(spec));
  const PressTimes press = press_times(spec.seconds);
  Outcome outcome;
  LocalTouch local(spec, scenes, force_scale);
  Hash hash;
  double steps2 = 0, last_n = 0, low_m = 1e300, high_m = -1e300, most_j = 0;
  std::int64_t touching = 0, acted = 0, done = 0;
  const std::int64_t first_ticks = ticks + std::llround(3 * spec.rate_hz);  // until it is engaged
  std::int64_t moved = 0;
  double stop_after_s = std::numeric_limits<double>::infinity();
  double now_s = 0;
  double rests_at_w_nm = 0, rests_since_s = 0;
  for (std::int64_t k = 0; k < first_ticks && moved < ticks && now_s < stop_after_s; ++k, ++done) {
    const int periods = faults.periods();
    if (hand->started()) acts.step(session.period_s() * static_cast<double>(moved));
    InvariantWatch::Around around;
    around.given_before_j = hand->account().given_j();
    around.q_before_j = hand->account().quantum_bound_j();
    around.periods = periods;
    const Vec3 began_h_m = hand->pos_h_m();
    const Vec3 seen_h_m = hand->encoder_h_m();
    const std::uint32_t buttons = hand->held_buttons();
    const recording::Sample& row = session.step(periods);
    if (const recording::Sample* const kept = recorder(row); kept != nullptr) {
      const bool counted =
          hand->too_fast() || RecordWatch::has_energy(*kept, around.given_before_j, around.q_before_j);
      const bool said = !watch->keeps_said || record.has_force(*kept, watch->said);
      if (!record.is_true(*kept, began_h_m, hand->applied_h_n(), periods) || !counted || !said)
        invariants.violate(kInvariantRecord, row.time_s);
    }
    acts.step_rival(periods);
    around.reply_ns = session.client().has_reply() ? session.client().reply_time_ns() : -1;
    around.time_s = row.time_s;
    around.silent_s = faults.silent_s();
    invariants.look(row, *hand, *watch, around);
    if (replies->watches() &&
        !replies->is_true(*watch, session.server().counters().exchanges, 1e-9 * row.force_scale))
      invariants.violate(kInvariantReplies, row.time_s);
    now_s = row.time_s;
    if (hand->started()) moved += periods;
    const double t_s = session.period_s() * static_cast<double>(moved);
    faults.step(row, *hand, *watch, t_s, invariants);
    local.add(row, session.period_s() * periods, acts.scaling().force,
              acts.quiet_s(t_s) > 0.3 + 2e-3 * spec.rtt_ms);
    lead.look(lead_tick(row, session, acts, seen_h_m, buttons, periods, *watch, what.waits_s > 0,
                        what.waits_s == 0 && spec.late == 0 && spec.quantum_m == 0 && is_task(spec.hand)));
    if (!lead.leads()) invariants.violate(kInvariantLead, now_s);
    if (!lead.lets_go()) invariants.violate(kInvariantLetGo, now_s);
    if (!lead.is_smooth()) invariants.violate(kInvariantJump, now_s);
    commands.look(command_tick(row, session));
    for (const Vec3& to_w_nm : watch->follows_w_nm) commands.follows(to_w_nm);
    watch->follows_w_nm.clear();
    if (!commands.tells()) invariants.violate(kInvariantSent, now_s);
    if (!commands.keeps_to_the_path()) invariants.violate(kInvariantPath, now_s);
    if (acts.refusal_changed_something() || acts.accepted_too_stiff())
      invariants.violate(kInvariantRefusal, now_s);

    if (std::fabs(row.tip_target_w_nm[2] - rests_at_w_nm) * ground.metres_per_nm > kMovedM) {
      rests_at_w_nm = row.tip_target_w_nm[2];
      rests_since_s = now_s;
    }

    const double force_n = row.hand_force_applied_h_n[2];
    hash.add(force_n);
    hash.add(hand->pos_h_m().z());
    steps2 += (force_n - last_n) * (force_n - last_n);
    last_n = force_n;
    const double x_n = row.hand_force_applied_h_n[0], y_n = row.hand_force_applied_h_n[1];
    // The sum of the components is no less than the norm, but for rounding, and takes no division.
    if ((std::fabs(x_n) + std::fabs(y_n) + std::fabs(force_n)) * (1 + 1e-12) > outcome.peak_n)
      outcome.peak_n = std::max(outcome.peak_n, std::hypot(x_n, y_n, force_n));
    using namespace recording;
    outcome.clamp_ticks += (row.limit_flags & kLimitClamp) != 0;
    outcome.limit_ticks += (row.limit_flags & kLimitForce) != 0;
    if (row.limit_flags & kLimitStop) {
      ++outcome.stop_ticks;
      if (outcome.stopped_s < 0 &&
          !(spec.act == Act::kStop && row.station_faults == station::kFaultStopPressed)) {
        outcome.stopped_s = t_s;
        outcome.faults = row.station_faults;
        stop_after_s = now_s + 0.5;
      }
    }
    if (watch->touches) {
      ++touching;
      acted += (row.limit_flags & (kLimitDamper | kLimitClamp)) != 0;
    }
    if (hand->too_fast() && outcome.too_fast_s < 0) outcome.too_fast_s = t_s;
    if (spec.hand == HandKind::kPress && t_s < press.out_s &&
        t_s > press.out_s - 0.25 * (press.out_s - press.held_s)) {
      low_m = std::min(low_m, hand->pos_h_m().z());
      high_m = std::max(high_m, hand->pos_h_m().z());
    }
    if (hand->account().most_extracted_j() > most_j) {
      most_j = hand->account().most_extracted_j();
      if (extras.most_extracted_at_s != nullptr) *extras.most_extracted_at_s = t_s;
    }
    if (extras.trace != nullptr)
      extras.trace->push_back({t_s, 1e3 * (ground.wall_m - hand->pos_h_m().z()), force_n,
                               1e3 * hand->account().extracted_j(), 1e3 * row.account_j,
                               1e3 * what.hand_j_per_aj * watch->net_in_aj, faults.down()});
    if (spec.hand == HandKind::kPath && t_s >= spec.seconds) break;
  }
  const TrueAccount& account = hand->account();
  if (const auto asked = felt_limits(spec)) {
    outcome.felt = local.felt(0.2 + 1.5e-3 * spec.rtt_ms);
    if (const std::uint32_t wrong =
            felt_violations(outcome.felt, {local.ratio(), local.lateral_ratio()}, *asked))
      invariants.violate(wrong, now_s);
  }
  if (const auto share = share_limits_of_acts(spec);
      share && (local.ratio() < share->low || local.ratio() > share->high))
    invariants.violate(kInvariantFelt, now_s);
  // Hand and tip have been at rest for longer than the link takes: what is left between them is drift.
  const double arrives_s =
      0.3 + 1e-3 * (2 * spec.rtt_ms * (1 + spec.jitter) + (spec.loss > 0 ? 3 * spec.burst_ms : 0));
  const bool at_rest = is_task(spec.hand) && now_s - rests_since_s > arrives_s && outcome.stopped_s < 0 &&
                       !faults.down() && session.loop().trace().mode == station::Mode::kEngaged;
  outcome.drift_mm = at_rest
                         ? 1e3 * ground.metres_per_nm *
                               (watch->commanded_w_nm.z() - session.loop().trace().tip_target_pos_w_nm.z())
                         : kNan;
  if (const auto most_mm = drift_limit_mm(spec); most_mm && std::fabs(outcome.drift_mm) > *most_mm)
    invariants.violate(kInvariantFollow, now_s);
  outcome.violated = invariants.violated();
  outcome.violated_s = invariants.first_s();
  outcome.margin_mj = 1e3 * invariants.least_margin_j();
  outcome.extracted_mj = 1e3 * account.most_extracted_j();
  outcome.given_mj = 1e3 * account.most_given_j();
  outcome.generated_mj = 1e3 * invariants.most_generated_j();
  outcome.quantum_mj = 1e3 * account.quantum_bound_j();
  outcome.late_mj = 1e3 * invariants.late_j();
  outcome.force_step_n = done > 0 ? std::sqrt(steps2 / static_cast<double>(done)) : 0;
  outcome.force_error_n = local.rms_n();
  outcome.shown_ratio = local.ratio();
  outcome.tip_nn = watch->most_force_nn;
  outcome.over_force = local.over_force(watch->most_force_nn);
  outcome.swing_mm = high_m >= low_m ? 1e3 * (high_m - low_m) : kNan;
  outcome.duty = touching > 0 ? static_cast<double>(acted) / static_cast<double>(touching) : 0;
  outcome.recover_s = invariants.slowest_recovery_s();
  outcome.refused = acts.refused();
  outcome.handed_over = acts.handed_over();
  outcome.sessions = static_cast<std::int64_t>(session.client().sessions());
  outcome.ticks = done;
  outcome.hash = hash.value();
  if (extras.path_m != nullptr) {
    *extras.path_m = hand->path_m();
    for (double& z : *extras.path_m) z -= ground.wall_m;
  }
  return outcome;
}

}  // namespace telenano::studies::stress

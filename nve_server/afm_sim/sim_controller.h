#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "telenano/common/base/random.h"
#include "telenano/nve_server/afm_sim/sim_config.h"
#include "telenano/nve_server/afm_sim/sim_tip.h"
#include "telenano/nve_server/nanonis/codec.h"

namespace telenano::afm_sim {

/// The rig behind its controller, without sockets: calls go in at a time, answers come out when a controller
/// would give them. Time goes by advance_to(). A value: a copy goes on alike.
///
/// Acquisition: a signal is averaged over periods that end at multiples of the period. A value asked for is
/// that of the period that ends next (newest = 0), or of the one after it (newest = 1).
class SimController {
 public:
  SimController(const SimConfig& config, std::shared_ptr<const scene::Scene> scene);

  /// A call under way: given back by begin(), asked for its answer until there is one.
  struct Pending {
    nanonis::Call call;
    std::int64_t ready_ns = 0;
    enum class Wait : std::uint8_t { kTime, kWithdrawn, kArrived } wait = Wait::kTime;
    std::int64_t deadline_ns = 0;  ///< of a wait
    nanonis::Answer answer;
    bool reads = false;  ///< signals: the answer is made when it is ready
  };
  /// What the call does begins now. `port`: 0 to 3, where roles are restricted; −1: any.
  Pending begin(const nanonis::Call& call, int port, std::int64_t now_ns);
  /// True when the answer is there.
  bool finish(Pending& pending, std::int64_t now_ns);

  void advance_to(std::int64_t now_ns) noexcept;

  nanonis::ZStatus status() const noexcept { return status_; }
  const SimTip& tip() const noexcept { return tip_; }
  SimTip& tip() noexcept { return tip_; }
  double height_nm() const noexcept { return piezo_nm_.z(); }  ///< as told, away from the sample positive
  /// Limits that were set as floats, and are off again, may have stopped it 1e-5 nm below the end.
  bool withdrawn() const noexcept { return piezo_nm_.z() >= retracted_nm() - 1e-3; }
  std::uint64_t safe_tips() const noexcept { return safe_tips_; }
  std::uint64_t moves() const noexcept { return moves_; }  ///< calls that moved or may move the tip
  const SimConfig& config() const noexcept { return config_; }

  /// From now on.
  void set_sensor_fault(SensorFault fault) noexcept;
  /// The next `count` withdrawals; negative: all.
  void set_withdraw_fault(WithdrawFault fault, int count) noexcept {
    withdraw_fault_ = fault;
    withdraw_faults_ = count;
  }
  /// Somebody changes the calibration of the deflection: what it says in metres is so many times as much.
  void scale_calibration(double factor) noexcept { calibration_factor_ = factor; }
  /// The laser weakens or wanders on the photodiode: of the bending so much is seen, from another zero.
  void set_photodiode(double gain, double zero_nm) noexcept {
    photodiode_gain_ = gain;
    photodiode_zero_nm_ = zero_nm;
  }
  /// For so long the deflection's signal is so much too low.
  void dip(double depth_nm, std::int64_t length_ns) noexcept {
    dip_nm_ = depth_nm;
    dip_until_ns_ = now_ns_ + length_ns;
  }
  void watch_by_safe_tip(int signal) noexcept { config_.safe_tip_signal = signal; }
  /// Its program ends and begins again: its settings are those of its start, the tip stays where it is.
  void restart() noexcept;
  bool limits_enabled() const noexcept { return limits_on_; }
  double limit_high_m() const noexcept { return limit_high_m_; }
  double limit_low_m() const noexcept { return limit_low_m_; }

 private:
  double sensed_nm(double bend_nm) const noexcept;
  double safe_tip_signal() const noexcept;
  double converted_v(double volts) const noexcept;
  double retracted_nm() const noexcept;
  double withdraw_to_nm() const noexcept;
  double lowest_nm() const noexcept;
  double true_value(int index) const noexcept;
  void step(double dt_s) noexcept;
  void end_acquisition() noexcept;
  bool busy() const noexcept;
  void execute(const nanonis::Call& call, std::int64_t now_ns, Pending& pending);
  void move_across(const nanonis::Call& call, Pending& pending);
  void set_z(double z_m, Pending& pending);
  void switch_z(bool on, std::int64_t now_ns) noexcept;
  void withdraw(const nanonis::Call& call, std::int64_t now_ns, Pending& pending);
  void set_limits(double high_m, double low_m, Pending& pending);
  void set_acquisition(double period_s, Pending& pending);
  void ask_signals(const nanonis::Call& call, Pending& pending) const;
  void tell_calibration(double index, Pending& pending) const;
  std::vector<double> told(nanonis::CommandId question) const;

  SimConfig config_;
  SimTip tip_;
  Random random_;
  nanonis::ZStatus status_ = nanonis::ZStatus::kOff;
  std::int64_t now_ns_ = 0;
  Vec3 piezo_nm_ = Vec3::Zero();   // as told now
  Vec3 target_nm_ = Vec3::Zero();  // across: goes there at speed
  double speed_nm_s_ = 1000;
  bool custom_speed_ = true;
  std::int64_t off_at_ns_ = 0;
  bool limits_on_ = false;
  double limit_high_m_ = 0, limit_low_m_ = 0;
  bool safe_tip_on_ = false;
  std::array<double, 3> safe_tip_{0, 0, 0};  // recovery, pause, threshold
  std::uint64_t safe_tips_ = 0;
  SensorFault sensor_fault_ = SensorFault::kNone;
  double frozen_bend_nm_ = 0;
  WithdrawFault withdraw_fault_ = WithdrawFault::kUndone;
  int withdraw_faults_ = 0;  // still to come
  double half_way_nm_ = 0;   // where this withdrawal ends
  bool half_way_ = false;
  std::uint64_t moves_ = 0;
  // The average under way and the last one.
  std::int64_t acquisition_ns_ = 0;
  std::int64_t next_acquisition_ns_ = 0;
  double sum_s_ = 0, sum_deflection_ = 0, sum_lateral_ = 0;
  double value_deflection_m_ = 0, value_lateral_v_ = 0;
  double calibration_factor_ = 1;
  double photodiode_gain_ = 1, photodiode_zero_nm_ = 0;
  double dip_nm_ = 0;
  std::int64_t dip_until_ns_ = 0;
  SimConfig at_start_;
};

}  // namespace telenano::afm_sim

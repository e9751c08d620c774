#pragma once

#include "telenano/common/link/messages.h"
#include "telenano/common/link/priced_energy.h"
#include "telenano/nve_server/slave/slave.h"

namespace telenano::server {

/// The slave's side of the control methods, between the protocol and any slave: what a command is allowed to
/// do, by the method that the station says it runs, and what the reply has to tell it. nm, nN, aJ.
///
/// `tdpa`, `tank`. The commanded end follows the target as far as the energy that came with the commands
/// pays for it. Before a step its cost is foreseen as −F·Δx + ½K(Δx·F̂)², K the stiffest that the port can
/// show; of a move that costs more than there is, the part against the force is shortened. Ground that is met
/// on the way cannot be foreseen: so that it costs no more than kUnforeseenJ more, a step is no longer than
/// −F·Δx + ½K|Δx|² allows. What actually was exchanged is counted afterwards, from the slave's own account. A lag
/// behind the target is caught up in kCatchUp_s where there is energy for it: drift is compensated from
/// surplus only.
///   tdpa:  W = Σ received − Σ put into the port                        (its output is in the reply already)
///   tank:  level = Σ received − Σ put in + Σ given back − Σ sent
/// The slave has no allowance of its own, which a restart would grant once more: the station sends it one,
/// once (two_layer_tank.h). The tank sends what the port gave back, and within kSurplusReturn_s what was not
/// needed.
///
/// `wave`. The end moves by the wave that came: with f = −F, b = b_w as the tip feels it, and the port's
/// stiffness K against a step into the sample taken implicitly,
///   v = (√(2b) u − f)/(b + K T),   w = (f − b v)/√(2b),   ½w²T ≤ ½u²T − ΔE_port + owed, owed ≤ 0
/// (common/control/wave_port.h). What a wave of the formula's size leaves of that energy is surplus, and pays
/// for catching up the lag behind the commanded position, which a wave does not know. Energy of the waves
/// themselves must not: a hand at rest brings none after it, and its force would fade.
///
/// Other methods leave the command as it is.
///
/// **Another scale** changes what a joule at the tip is worth at the hand, and must make none there. What the
/// port has in hand, level and surplus, keeps its worth in hand joules, debts likewise: they are multiplied
/// by the new energy_scale_aj_j over the old. What lies in the sample is worth what was paid for it
/// (priced_energy.h): counted is not the port's charge but what may be credited for it, or must be paid. The
/// station says its scale with every command, whatever its method, so that nothing is pressed unseen.
///
/// **Another method.** What was pressed while a method without energy on its way drove the tip (`none`, `ks`, `ks-clamp`,
/// `model`, `twin`) is in the hand's own account, which the next method takes over. It must not come back from here once more:
/// it lies in the sample at the price 0.
///
/// **Finite.** Of a scale that no pair of scales makes, and of sums that no session comes to, nothing is
/// believed: every sum here stays finite, whatever a station sends.
class PortControl {
 public:
  /// A new session id: the station's sums begin at 0 again; what is owed stays owed.
  void begin_session() noexcept;

  /// What the slave is to be told for `command`. `last` is its last output, `limits` its own.
  slave::SlaveInput before(const link::Command& command, const slave::SlaveInput& input,
                           const slave::SlaveOutput& last, const slave::SlaveLimits& limits,
                           double dt_s) noexcept;
  /// Instead of before() and after(), for a command that moves nothing because another one holds the tip, or
  /// that has not taken up its position yet: what its station sends is kept for later, where the tip will be
  /// then is nothing to catch up.
  void observe(const link::PortControl& control) noexcept;
  /// Accounts for the step that the slave has made of it.
  void after(const slave::SlaveOutput& last, const slave::SlaveOutput& now, double dt_s) noexcept;
  /// Fills the reply's part.
  const link::PortAnswer& answer() const noexcept { return answer_; }

  /// Shows to `v` what stays of it when the session goes to another server, for writing it down or reading it.
  /// False: no such state.
  template <class V, class Self>
  static bool fields(V& v, Self& self) noexcept {
    std::uint64_t method = self.method_;
    v(method);
    v(self.energy_scale_aj_j_);
    v(self.wave_impedance_n_s_m_);
    v(self.level_aj_);
    v(self.answer_.energy_sent_aj);
    for (int i = 0; i < 3; ++i) v(self.answer_.wave_sum[i]);
    v(self.answer_.wave_energy_aj);
    const bool good = link::PricedEnergy::fields(v, self.sample_) && method <= link::kMethodTwin &&
                      self.energy_scale_aj_j_ >= 0 && self.energy_scale_aj_j_ <= kScaleMost &&
                      self.wave_impedance_n_s_m_ >= 0 && self.answer_.energy_sent_aj >= 0 &&
                      self.answer_.wave_energy_aj >= 0;
    if constexpr (V::kReads) self.method_ = good ? static_cast<std::uint32_t>(method) : 0;
    return good;
  }

  double level_aj() const noexcept { return level_aj_; }  ///< W, the tank, or what the waves owe

  static constexpr double kUnforeseenJ = 1e-4;  ///< hand joules
  static constexpr double kReserveJ = 0.007;    ///< likewise: kept, so that the next touch can begin
  static constexpr double kCatchUp_s = 0.05;
  /// More has not come: 10¹² J at the hand of an ordinary scaling.
  static constexpr double kMostAj = 1e30;
  static constexpr double kScaleLeast = 1e-12, kScaleMost = 1e24;  ///< aJ/J, believed
  static constexpr double kSurplusReturn_s = 1.0;

 private:
  bool pays_for_moves() const noexcept;
  void receive(const link::PortControl& control) noexcept;
  bool rescale(double energy_scale_aj_j) noexcept;
  double worth_aj(double charge_aj) noexcept;
  Vec3 paid_move(const Vec3& move_w_nm, const Vec3& force_w_nn, double stiffness_n_m,
                 double budget_aj) const noexcept;
  Vec3 wave_move(const Vec3& lag_w_nm, const slave::SlaveOutput& last, double stiffness_n_m,
                 double dt_s) noexcept;
  void send_wave(const slave::SlaveOutput& now, const Vec3& moved_w_nm, double charge_aj,
                 double dt_s) noexcept;

  std::uint32_t method_ = 0;
  double energy_scale_aj_j_ = 0;
  double wave_impedance_n_s_m_ = 0;
  link::PortControl received_;  // the highest sums of this session
  link::PricedEnergy sample_;   // what the port has taken and given, at the scale of that time
  double came_aj_ = 0;          // with this command
  Vec3 wave_came_ = Vec3::Zero();
  double wave_came_aj_ = 0;
  double wave_used_aj_ = 0;
  double wave_surplus_aj_ = 0;
  double level_aj_ = 0;
  bool has_target_ = false;
  Vec3 target_w_nm_ = Vec3::Zero();
  link::PortAnswer answer_;
};

}  // namespace telenano::server

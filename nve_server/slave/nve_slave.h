#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "telenano/nve_server/physics/equilibrium/level_equilibrium.h"
#include "telenano/nve_server/physics/equilibrium/potential_equilibrium.h"
#include "telenano/nve_server/physics/probe/probe.h"
#include "telenano/nve_server/scene/scene.h"
#include "telenano/nve_server/slave/port_model.h"
#include "telenano/nve_server/slave/slave.h"
#include "telenano/nve_server/slave/touched_sample.h"

namespace telenano::slave {

/// The nanoscale virtual environment behind the slave's port.
///
/// A step moves the commanded end towards the target — never faster than the speed limit, never out of the
/// workspace, never deeper than where the force is force_max — and solves coupling, probe and contact
/// together (see Balance). The damper of the coupling is taken by backward Euler:
///   k_c e + b_c (e − e_prev)/dt + F = 0, e = commanded end − probe's base,
/// so that e's spring has the compliance 1/(k_c + b_c/dt) and the free end is shifted by
/// −e_prev·(b_c/dt)/(k_c + b_c/dt). A probe with a mode (physics/probe_mode.h) enters alike: its motion
/// without force shifts the free end along its shape u, and what the force of this step adds is a compliance
/// c_m u uᵀ besides that of the rest of the lever. The step is cut so that the mode is resolved, or, where
/// that took more than ProbeMode::kMaxPieces, the mode is quasi-static; on a curved surface also into pieces
/// of kSubstepRadii tip radii. The commanded end moves evenly over the pieces; where a piece ends with the
/// tip on its way down a slide, the rest is left for the next step (kFaultStepLimit), so that a slide costs a
/// step no more than one search for a balance.
///
/// Force limit: both the normal force and the magnitude of the whole force on the tip, lateral part included,
/// stay within force_max; the end is drawn back along the normal, which relieves friction too, since that
/// goes with the contact.
///
/// deflection_nm is F_z-equivalent: C_zz F_z, the height by which the vertical force alone lifts the apex
/// (with a mode: u_z q + C_rest,zz F_z). What an optical lever would read is Probe::optical_deflection_nm.
///
/// Balance: on a level sample with nothing on it physics::LevelEquilibrium, the law itself; elsewhere
/// physics::PotentialEquilibrium, whose charges need nothing for geometry, and beside a particle that does
/// not sleep physics::ParticleEquilibrium on the same ground. A descent that goes on in the next step is
/// counted as far as it came.
///
/// Work: where a step has made SlaveInput::work_most, what is left of its way is left for the next
/// (kFaultShare). A particle's step is not cut but shortened before, to what so much work goes as a rule.
///
/// Marks: with a hardness the session has a surface of its own (physics::MarkedPotential), lowered by what
/// each accepted balance yielded. While the tip is in contact the end then moves in pieces of kMarkRadii
/// contact radii: a groove's depth goes by the length of the piece to first order, 8 % at half a contact
/// radius.
///
/// Energy account: each step charges the port with Δ(U_tip–sample + U_probe + U_coupling) + dissipated, U_probe
/// = ½ FᵀC F (with a mode ½ FᵀC_rest F + ½ m q'² + ½ k q²), dissipated = jumps of the branch + b_c|Δe|²/dt +
/// the mode's damping + friction + flow; the positive steps sum to energy_in, the negative ones to
/// energy_out. U is a function of the state, so that no path, however sampled, draws more than was put in.
/// The trapezia of a sampled port are not: round a closed path over relief they may come to more than is
/// stored or dissipated. There the charges, summed since the slave began, are never less than the trapezia;
/// what they lack is charged, and dissipated. So the account is passive both ways: it never gives back more than
/// it holds, and never asks for less than the port has brought. So does a mode that moves between samples, by
/// its numerical loss. On a flat sample the port's work over a step lies between −F₀·Δx and −F₁·Δx: a charge
/// below is raised to it, the difference being dissipated; a charge above (the end of the step has more than
/// was brought, as a strongly curved attraction may do) is lowered by slowing down the mode. Over
/// relief the mode's own numerical loss counts instead (ModeLoss); without marks and particle the force held
/// over a step of the mode is the one whose work is what all else has set free (a discrete gradient), and the
/// mode's own loss is rounding, wherever the step is smooth and resolves the contact.
class NveSlave final : public Slave {
 public:
  explicit NveSlave(std::shared_ptr<const scene::Scene> scene);
  /// The second and further slaves of a scene: `ground` of it is known.
  NveSlave(std::shared_ptr<const scene::Scene> scene, const PortGround& ground);

  void step(const SlaveInput& input, double dt_s, SlaveOutput& output) noexcept override;
  const SlaveLimits& limits() const noexcept override { return limits_; }

  /// Everything that the last step knew, for tests and studies.
  struct Trace {
    Vec3 commanded_end_w_nm = Vec3::Zero();
    Vec3 coupling_extension_w_nm = Vec3::Zero();
    physics::TipSolution tip;
    physics::ModeState mode;
    double stored_aj = 0;
    double dissipated_aj = 0;           ///< cumulative
    double mode_damped_aj = 0;          ///< cumulative, of these: by the quality factor
    double mode_numerical_aj = 0;       ///< cumulative, of these: by the sampling of a mode
    double mode_slowed_aj = 0;          ///< cumulative: taken out of the mode's kinetic energy
    double mode_unpaid_aj = 0;          ///< cumulative: charged though the port did not bring it
    std::uint64_t under_way_steps = 0;  ///< that ended without a balance, the tip on its way down
    double uncounted_aj = 0;  ///< cumulative, of these: work that potential and losses do not account for
  };
  Trace trace() const noexcept;
  /// 64 bits over everything that later steps depend on, warm starts included; the same steps from the same
  /// state give the same. Memory layout and history are not in it. Takes some hundred nanoseconds.
  std::uint64_t state_hash() const noexcept override;
  /// The state as bytes (state_fields.h); 0: they do not fit. At most kSnapshotBytes and, where marks stay,
  /// 20 a changed node and 40 a changed coefficient of the fields. Does not allocate;
  /// looks at every node of a surface with marks.
  std::size_t save(std::span<std::uint8_t> out) const noexcept override;
  static constexpr std::size_t kSnapshotBytes = 8192;
  /// Takes up what save() of a slave of the same scene wrote. Bytes may be anybody's: false, and the state is
  /// that of the beginning, for what is no such state. Does not allocate.
  bool load(std::span<const std::uint8_t> bytes) noexcept override;
  /// As it was made. Does not allocate.
  void reset() noexcept override;
  std::size_t snapshot_bytes_max() const noexcept override;

  /// Energy in coupling, probe and sample: a function of the state, 0 far away and at rest.
  double stored_aj() const noexcept { return port().stored_aj; }
  bool say_again(SlaveOutput& output) noexcept override {
    publish(last_faults_, output);
    return true;
  }

  UndoResult undo_marks(std::uint64_t of, SlaveOutput& output) noexcept override;

  /// Of the last step; 0: no contact, and beside a particle.
  double contact_radius_nm() const noexcept {
    return scene_->particle ? 0 : port().solution.contact_radius_nm;
  }
  /// Pull at which a contact lets go where the tip is, as its local model says; 0: not known.
  double adhesion_nn() const noexcept { return model_.adhesion_nn(port().solution); }

  const TouchedSample& sample() const noexcept { return sample_; }
  /// This session's own surface; null where no marks stay.
  const physics::SplineSurface* marked_surface() const noexcept { return sample_.marked_surface(); }
  std::shared_ptr<const surface::HeightView> heights() const override {
    return marked_surface() != nullptr ? marked_surface()->view() : nullptr;
  }
  /// Hears of every mark from now on, within the step that leaves it. Must outlive this slave.
  void set_mark_journal(physics::MarkJournal* journal) noexcept { sample_.set_mark_journal(journal); }

 private:
  // What one trial of the port's end may change; kept only if it is accepted.
  struct Port {
    Vec3 commanded_w_nm = Vec3::Zero();
    Vec3 extension_w_nm = Vec3::Zero();
    physics::LevelState level;
    physics::PotentialState potential;
    physics::TipSolution solution;
    physics::ModeState mode;
    double stored_aj = 0;
    double damped_aj = 0;  // by coupling and mode in this step
    physics::ModeLoss mode_loss;
  };
  // What all pieces of a step have in common.
  struct Piece {
    double dt_s = 0;
    physics::ModePropagator mode;
  };
  static constexpr double kSettle_s = 1.0;  // a first balance: longer than any damper or mode remembers
  Port& port() noexcept { return ports_[now_]; }
  const Port& port() const noexcept { return ports_[now_]; }
  Port& trial_port() noexcept { return ports_[1 - now_]; }
  void accept_trial() noexcept;
  template <class Visit, class Of>
  void visit_port(Visit& visit, Of& port) const noexcept;
  template <class Visit>
  void write_state(Visit& visit) const noexcept;
  Piece piece_of(double dt_s) const noexcept;
  int pieces(double dt_s, double distance_nm) const noexcept;
  /// The springs of this trial, which stay until the next; null: no balance.
  const physics::Compliance* solve(const Vec3& commanded_w_nm, const Piece& piece, const Port& from,
                                   Port& to) noexcept;
  /// Does the balance in `to` hold? Then what coupling and probe have stored and lost.
  bool settle(double k_total_n_m, double b_over_dt_n_m, const Port& from, Port& to) noexcept;
  /// A balance whose mode shall be moved by its mean force (mean_force.h).
  struct MovingProbe {
    const physics::ModeStep& step;
    const physics::Compliance& springs;
    const Vec3& free_end_w_nm;
    double k_total_n_m;
    double b_over_dt_n_m;
    double dt_s;
  };
  enum class MeanForceResult : unsigned char { kHeld, kNone, kNoBalance };
  MeanForceResult hold_mean_force(const MovingProbe& probe, const Port& from, Port& to) noexcept;
  double given_to_mode_aj(const Port& from, const Port& to) const noexcept;
  const physics::Compliance& springs_without_mode(double k_total_n_m) noexcept;
  bool solve_within_force_limit(const Vec3& commanded_w_nm, const Piece& piece, const Port& from, Port& to,
                                bool& held_back) noexcept;
  void account_for(const Port& before, const Piece& piece, Port& after) noexcept;
  void count_work(const physics::TipSolution& solution) noexcept;
  void publish(std::uint32_t fault_bits, SlaveOutput& output) noexcept;

  std::shared_ptr<const scene::Scene> scene_;
  SlaveLimits limits_;
  bool flat_;
  bool scalar_;  // flat, without friction or particle: nothing turns
  TouchedSample sample_;
  PortModel model_;
  std::array<Port, 2> ports_;  // the accepted one and the trial take turns, lest large states be copied
  std::size_t now_ = 0;
  double springs_k_total_n_m_ = 0;  // that springs_ belong to
  physics::Compliance springs_ = physics::Compliance::Zero();
  physics::Compliance mode_springs_ = physics::Compliance::Zero();
  Trace trace_;
  double energy_in_aj_ = 0;
  double energy_out_aj_ = 0;
  std::uint32_t last_faults_ = 0;
  std::uint32_t work_ = 0;              // of this step
  double paid_ahead_aj_ = 0;            // by how much the charges so far exceed the port's work
  std::vector<std::uint8_t> at_first_;  // the state as it was made
};

/// Makes slaves of one scene; what they have in common is found now.
std::function<std::unique_ptr<NveSlave>()> nve_slaves(std::shared_ptr<const scene::Scene> scene);

}  // namespace telenano::slave

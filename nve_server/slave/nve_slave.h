#pragma once

#include <memory>

#include "nve_server/physics/marked_sample.h"
#include "nve_server/physics/tip_equilibrium.h"
#include "nve_server/scene/scene.h"
#include "nve_server/slave/slave.h"

namespace telenano::slave {

/// The nanoscale virtual environment behind the slave's port.
///
/// A step moves the commanded end towards the target — never faster than the speed limit, never out of the
/// workspace, never deeper than where the normal force is force_max — and solves coupling, cantilever and
/// contact together (physics::TipEquilibrium). The damper of the coupling is taken by backward Euler:
///   k_c e + b_c (e − e_prev)/dt + F = 0, e = commanded end − cantilever's base,
/// so that e's spring has the compliance 1/(k_c + b_c/dt) and the free end is shifted by
/// −e_prev·(b_c/dt)/(k_c + b_c/dt).
///
/// Marks: with a hardness the session has a surface of its own (physics::MarkedSample), lowered by what each
/// accepted balance yielded. While the tip is in contact the end then moves in pieces of kMarkRadii contact
/// radii: a groove's depth goes by the length of the piece to first order, 8 % at half a contact radius.
///
/// Energy book: each step charges the port with Δ(U_tip–sample + U_cantilever + U_coupling) + dissipated,
/// dissipated = jumps of the branch + b_c|Δe|²/dt; the positive steps sum to energy_in, the negative ones to
/// energy_out. U is a function of the state, so that no path, however sampled, draws more than was put in. A
/// tip that slides off a summit loses energy that is not in the law's jumps: such a step is charged no less
/// than the trapezium of force and commanded displacement.
class NveSlave final : public Slave {
 public:
  explicit NveSlave(std::shared_ptr<const scene::Scene> scene);

  void step(const SlaveInput& input, double dt_s, SlaveOutput& output) noexcept override;
  const SlaveLimits& limits() const noexcept override { return limits_; }

  /// Everything that the last step knew, for tests and studies.
  struct Trace {
    Vec3 commanded_end_w_nm = Vec3::Zero();
    Vec3 coupling_extension_w_nm = Vec3::Zero();
    physics::TipSolution tip;
    double stored_aj = 0;
    double dissipated_aj = 0;  ///< cumulative
    std::uint64_t clamped_radius_steps = 0;
    std::uint64_t outside_steps = 0;
    std::uint64_t slides = 0;
  };
  const Trace& trace() const noexcept { return trace_; }
  /// This session's own surface; null where no marks stay.
  const physics::SplineSurface* marked_surface() const noexcept {
    return marked_ ? &marked_->surface() : nullptr;
  }

 private:
  // What one trial of the port's end may change; kept only if it is accepted.
  struct Port {
    Vec3 commanded_w_nm = Vec3::Zero();
    Vec3 extension_w_nm = Vec3::Zero();
    physics::TipState tip;
    physics::TipSolution solution;
    double stored_aj = 0;
  };
  bool solve(const Vec3& commanded_w_nm, double dt_s, const Port& from, Port& to) const noexcept;
  bool solve_within_force_limit(const Vec3& commanded_w_nm, double dt_s, const Port& from, Port& to,
                                bool& held_back) const noexcept;
  void book(const Port& before, const Port& after, double dt_s) noexcept;
  void publish(std::uint32_t fault_bits, SlaveOutput& output) noexcept;

  std::shared_ptr<const scene::Scene> scene_;
  std::unique_ptr<physics::MarkedSample> marked_;
  SlaveLimits limits_;
  bool flat_;
  Port port_;
  Trace trace_;
  double energy_in_aj_ = 0;
  double energy_out_aj_ = 0;
};

}  // namespace telenano::slave

#pragma once

#include <cstdint>

#include "telenano/common/control/contact_plane.h"

namespace telenano::control {

/// Renders a ContactPlane at the station's own rate, with hysteresis of touch and a bristle for friction. The
/// model in use may differ from the newest one heard: it goes over to it no faster than the energy and force
/// that each step is given allow. Tip units: nm, nN, aJ.
class ModelRenderer {
 public:
  /// No model shown will be stiffer than this, along the normal and across it each.
  explicit ModelRenderer(double stiffness_max_n_m) noexcept : stiffness_max_n_m_(stiffness_max_n_m) {}

  /// The slave's newest model; `touching`: its tip was in contact at command `answers`.
  void on_reply(const ContactPlane& model, bool touching, std::uint64_t answers) noexcept;
  void forget() noexcept;
  void renumber() noexcept { answers_ = changed_at_ = 0; }  ///< commands are counted from 1 again

  /// The force on the tip at the commanded position `target_w_nm` of command number `command`. Before, goes
  /// over to the newest model as far as the potential rises by no more than `energy_aj` and the force changes
  /// by no more than `force_step_nn`.
  Vec3 force_w_nn(const Vec3& target_w_nm, std::uint64_t command, double energy_aj,
                  double force_step_nn) noexcept;

  bool has_model() const noexcept { return heard_.version != 0; }
  bool attached() const noexcept { return attached_; }
  const ContactPlane& model() const noexcept { return model_; }
  /// Potential of the model in use at `target_w_nm`, bristle included.
  double potential_aj(const Vec3& target_w_nm) const noexcept;

 private:
  ContactPlane blend(double part) const noexcept;
  ContactPlane capped(ContactPlane model) const noexcept;
  bool touched(const ContactPlane& model, const Vec3& target_w_nm) const noexcept;
  double normal_potential_aj(const ContactPlane& model, const Vec3& target_w_nm) const noexcept;
  Vec3 normal_force_w_nn(const ContactPlane& model, const Vec3& target_w_nm) const noexcept;
  void follow(const Vec3& target_w_nm, double energy_aj, double force_step_nn) noexcept;
  void touch(const Vec3& target_w_nm, std::uint64_t command) noexcept;
  void shear(const Vec3& moved_w_nm) noexcept;

  double stiffness_max_n_m_;
  ContactPlane heard_;
  ContactPlane model_;  // in use
  bool slave_touches_ = false;
  std::uint64_t answers_ = 0;
  std::uint64_t changed_at_ = 0;  // command at which touch last changed here
  bool attached_ = false;
  bool started_ = false;
  Vec3 last_target_w_nm_ = Vec3::Zero();
  Vec3 bristle_w_nm_ = Vec3::Zero();
};

}  // namespace telenano::control

#pragma once

#include "telenano/common/control/model_renderer.h"
#include "telenano/common/control/one_port.h"
#include "telenano/common/control/station_method.h"

namespace telenano::control {

/// `model`: the local contact model, with the clamp. The slave says what its port is like around the tip
/// (contact_model.h); the station renders that at its own rate, without the link's delay in the loop, so that
/// at any delay its stiffness may be what the device alone can show, K ≤ kStiffnessPart · 2b/T.
///
/// *What is paid for.* A new model is taken up as far as its potential at the present position is no higher
/// than what there is: ΔU ≤ E + E₀ − U, with E the account of the port (passivity_controller.h). Apart from
/// its ground nothing need be paid, so a wall that was met once is there, whole, at the next touch. The
/// pre-commit clamp stands behind it: whatever models come, no hand extracts more than E₀ beyond what was put
/// in.
///
/// *The sample's own energy.* A tip that snaps in is pulled by the sample, and the hand with it: that is no
/// leak of the link. The most that the sample has ever given beyond what was put in is credited, once, at
/// most the well that it can have (SlaveNews); what is put in is never debited, for over a delay it is not
/// the hand's work. So a server that lies in every sum gets E₀ and that well.
///
/// *What is felt besides.* Where the slave does not touch and the model's ground is not reached, its force is
/// attraction across a gap, and shown as it comes, low-passed by kFarField_s: its slope is small, and no loop
/// of any stiffness goes through the link. A slave that sends no model leaves `ks-clamp`.
///
/// It does not protect the tip, which goes on by the delay times the hand's speed: the slave limits its own
/// force.
class ModelMethod final : public StationMethod {
 public:
  explicit ModelMethod(const MethodConfig& config) noexcept;

  void take_over(double account_j, const MethodConfig& config, const Vec3& hand_pos_h_m) noexcept override;
  void begin_session(bool new_epoch) noexcept override;
  void account_for(const PortInterval& interval) noexcept override { controller_.account_for(interval); }
  void on_reply(const SlaveNews& news) noexcept override;
  Vec3 force_h_n(const RenderPoint& at) noexcept override;
  Vec3 damper_force_h_n() const noexcept override { return controller_.damper_force_h_n(); }
  double damper_n_s_m() const noexcept override { return controller_.damper_n_s_m(); }
  double force_bound_n() const noexcept override { return controller_.force_bound_n(); }
  double account_j() const noexcept override { return controller_.account_j(); }
  const ModelRenderer& renderer() const noexcept { return renderer_; }

  static constexpr double kStiffnessPart = 0.9;
  static constexpr double kFarField_s = 0.02;

 private:
  static ModelRenderer renderer_for(const MethodConfig& config) noexcept;

  MethodConfig config_;
  PassivityController controller_;
  ModelRenderer renderer_;
  Vec3 slave_force_h_n_ = Vec3::Zero();
  bool slave_touches_ = false;
  bool other_slave_ = false;  // the model in use is of the last epoch's
  Vec3 far_field_h_n_ = Vec3::Zero();
};

}  // namespace telenano::control

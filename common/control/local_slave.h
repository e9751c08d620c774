#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "telenano/common/base/vec3.h"

namespace telenano::surface {
class HeightView;  // passed on to who draws; nothing here looks into it
}

namespace telenano::control {

/// One step of the slave, as the server will make it too.
struct LocalStep {
  Vec3 target_w_nm = Vec3::Zero();
  Vec3 vel_w_nm_s = Vec3::Zero();
  std::uint32_t flags = 0;  ///< of the command
  bool operates = true;     ///< of a shared tip: it belongs to the present holding; else it moves nothing
  double dt_s = 1e-3;
};

/// What the slave says after it.
struct LocalAnswer {
  Vec3 force_w_nn = Vec3::Zero();  ///< on the tip
  Vec3 tip_pos_w_nm = Vec3::Zero();
  Vec3 commanded_pos_w_nm = Vec3::Zero();
  double deflection_nm = 0;
  std::uint32_t contact_state = 0;  ///< link::ContactState
  std::uint32_t fault_bits = 0;     ///< link::FaultBits
  double energy_in_aj = 0;          ///< cumulative
  double energy_out_aj = 0;
  double stored_aj = 0;  ///< in coupling, probe and sample: a function of the state, 0 far away
  // What only a person wants to see.
  double contact_radius_nm = 0;  ///< 0: no contact
  double adhesion_nn = 0;        ///< pull at which a contact here lets go; 0: not known
};

/// Seam: the server's slave, run at the station; whose state is a function of its steps, to the bit. Nothing
/// here allocates, waits or throws. Control and station know no scene: who makes one of these does
/// (master/twin/scene_twin.h).
class LocalSlave {
 public:
  LocalSlave() = default;
  LocalSlave(const LocalSlave&) = delete;
  LocalSlave& operator=(const LocalSlave&) = delete;
  virtual ~LocalSlave() = default;

  virtual void step(const LocalStep& step, LocalAnswer& answer) noexcept = 0;
  /// 64 bits over all that later steps depend on; that of the server's slave after the same steps.
  virtual std::uint64_t state_hash() const noexcept = 0;
  /// As a new one.
  virtual void reset() noexcept = 0;
  /// Takes up the state of the server's slave, as its snapshot's bytes say; false, and as a new one, where
  /// they are no such state. `answer` is what it then says.
  virtual bool load(std::span<const std::uint8_t> bytes, LocalAnswer& answer) noexcept = 0;
  virtual std::size_t snapshot_bytes_max() const noexcept = 0;
  /// The deepest well that its sample can have, aJ: from the scene itself, not from what a server says.
  virtual double well_aj() const noexcept = 0;
  /// Of the scene: only a server that serves the same one has this twin.
  virtual std::uint64_t scene_hash() const noexcept = 0;
  /// The sample's heights as steps leave them, for threads that only look; null: no marks stay in it.
  virtual std::shared_ptr<const surface::HeightView> heights() const { return nullptr; }
};

}  // namespace telenano::control

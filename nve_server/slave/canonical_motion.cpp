#include "telenano/nve_server/slave/canonical_motion.h"

#include <bit>
#include <string_view>

#include "telenano/nve_server/slave/nve_slave.h"

namespace telenano::slave {
namespace {

/// FNV-1a (draft-eastlake-fnv), fed by numbers.
class Sum {
 public:
  void add(std::uint64_t bits) noexcept {
    for (int i = 0; i < 8; ++i) {
      hash_ ^= bits >> (8 * i) & 0xff;
      hash_ *= 0x100000001b3u;
    }
  }
  void add(double value) noexcept { add(std::bit_cast<std::uint64_t>(value)); }
  void add(const Vec3& v) noexcept {
    for (int axis = 0; axis < 3; ++axis) add(v[axis]);
  }
  void add(const SlaveOutput& o) noexcept {
    add(o.force_w_nn);
    add(o.tip_pos_w_nm);
    add(o.commanded_pos_w_nm);
    add(o.deflection_nm);
    add(static_cast<std::uint64_t>(o.contact_state));
    add(std::uint64_t{o.fault_bits});
    add(o.energy_in_aj);
    add(o.energy_out_aj);
    add(o.model.point_w_nm);
    add(o.model.normal_w);
    add(o.model.stiffness_n_m);
    add(o.model.adhesion_nn);
    add(o.model.shear_stiffness_n_m);
    add(o.model.friction_nn);
    add(o.particle.pos_w_nm);
    add(static_cast<std::uint64_t>(o.particle.status));
  }
  std::uint64_t value() const noexcept { return hash_; }

 private:
  std::uint64_t hash_ = 0xcbf29ce484222325u;
};

/// Moves a slave from place to place.
class Walk {
 public:
  explicit Walk(const std::shared_ptr<const scene::Scene>& scene)
      : slave_(scene), at_w_nm_(slave_.limits().start_pos_w_nm) {}

  void to(const Vec3& place_w_nm, int steps) {
    // Milliseconds that are no power of two, as stations have them, and now and then one that came late.
    constexpr double kStep_s = 1e-3;
    constexpr double kLate_s = 3.7e-3;
    const Vec3 from_w_nm = at_w_nm_;
    for (int i = 1; i <= steps; ++i) {
      at_w_nm_ = from_w_nm + (place_w_nm - from_w_nm) * (static_cast<double>(i) / steps);
      input_.tip_target_pos_w_nm = at_w_nm_;
      input_.wants_model = i % 2 == 0;
      slave_.step(input_, i % 17 == 0 ? kLate_s : kStep_s, output_);
      sum_.add(output_);
    }
  }
  std::uint64_t value() const noexcept { return sum_.value(); }

 private:
  NveSlave slave_;
  SlaveInput input_;
  SlaveOutput output_;
  Vec3 at_w_nm_;
  Sum sum_;
};

}  // namespace

std::uint64_t canonical_motion_hash(const std::shared_ptr<const scene::Scene>& scene) {
  constexpr double kDeep_nm = 3;
  constexpr double kAcross_nm = 6;
  Walk walk(scene);
  const Vec3 start = scene->start_apex_w_nm;
  const Vec3 touch(start.x(), start.y(), scene->start_touch_w_nm);
  const Vec3 pressed = touch - Vec3(0, 0, kDeep_nm);
  walk.to(touch + Vec3(0, 0, 1), 100);
  walk.to(pressed, 120);
  walk.to(pressed + Vec3(kAcross_nm, 0.37 * kAcross_nm, 0), 160);
  walk.to(pressed, 120);
  walk.to(touch + Vec3(0, 0, 12), 240);
  walk.to(start, 20);
  if (scene->particle) {
    // At half its height, through where it lies, and up again.
    const double radius = scene->particle->parameters.particle_radius_nm;
    const double reach = radius + scene->probe.tip_radius_nm + 5;
    const Vec3 particle(scene->particle->x_nm, scene->particle->y_nm, touch.z() + 1);
    walk.to(particle + Vec3(-reach, 0, 2 * radius + 5), 60);
    walk.to(particle + Vec3(-reach, 0, 0), 60);
    walk.to(particle + Vec3(0.3 * reach, 0, 0), 200);
    walk.to(particle + Vec3(0.3 * reach, 0, 3 * radius), 60);
  }
  return walk.value();
}

}  // namespace telenano::slave

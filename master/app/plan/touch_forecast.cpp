#include "telenano/master/app/plan/touch_forecast.h"

#include <algorithm>
#include <cmath>

#include "telenano/common/control/scaling_plan.h"
#include "telenano/common/link/messages.h"

namespace telenano::app {

TouchForecast forecast_touch(control::LocalSlave& slave, device::TaskOptions task, const Vec3& start_w_nm,
                             double surface_z_w_nm, double rate_hz,
                             const control::CompandingConfig& companding) {
  task.start_height_nm = start_w_nm.z() - surface_z_w_nm;
  task.retract_nm = std::max(task.retract_nm, task.start_height_nm);
  const device::IntendedMotion motion = device::IntendedMotion::for_task(device::Task::kIndent, task);
  const double dt_s = 1 / rate_hz;
  const auto steps = static_cast<std::int64_t>(std::ceil(motion.duration_s() * rate_hz));
  TouchForecast found;
  control::LocalAnswer answer;
  control::Companding far;
  far.configure(companding);
  double brought_aj = 0;
  slave.reset();
  Vec3 last_w_nm = start_w_nm;
  double deepest_nm = task.start_height_nm;
  for (std::int64_t i = 1; i <= steps; ++i) {
    const Vec3 way_nm = motion.pos_nm(static_cast<double>(i) * dt_s);
    control::LocalStep step;
    step.target_w_nm = {start_w_nm.x() + way_nm.x(), start_w_nm.y() + way_nm.y(),
                        surface_z_w_nm + way_nm.z()};
    step.vel_w_nm_s = (step.target_w_nm - last_w_nm) * rate_hz;
    step.flags = link::kFlagClutch | link::kFlagDeadman;
    step.dt_s = dt_s;
    last_w_nm = step.target_w_nm;
    slave.step(step, answer);
    const double force_nn = answer.force_w_nn.z();
    const bool touches = answer.contact_state == static_cast<std::uint32_t>(link::ContactState::kContact);
    found.touched = found.touched || touches;
    const double net_aj = answer.energy_in_aj - answer.energy_out_aj;
    far.step(answer.stored_aj, net_aj - brought_aj, touches);
    brought_aj = net_aj;
    if (!found.touched) found.way_in.push_back({way_nm.z(), -force_nn, -far.gain() * force_nn});
    found.push_nn = std::max(found.push_nn, force_nn);
    // On the way in the same force is the snap-in's.
    if (way_nm.z() < deepest_nm) {
      deepest_nm = way_nm.z();
      found.pull_off_nn = 0;
    } else {
      found.pull_off_nn = std::max(found.pull_off_nn, -force_nn);
    }
  }
  return found;
}

Noticed noticed(const std::vector<FarForce>& way_in, double n_per_nn, bool companded) {
  Noticed found;
  for (const FarForce& far : way_in) {
    const double felt_n = n_per_nn * (companded ? far.shown_nn : far.pull_nn);
    found.most_n = std::max(found.most_n, felt_n);
    if (felt_n >= control::kNoticedForceN) found.from_nm = std::max(found.from_nm, far.height_nm);
  }
  if (found.most_n > control::kNoticedForceN)
    found.differences = std::log(found.most_n / control::kNoticedForceN) / std::log1p(kForceJnd);
  return found;
}

}  // namespace telenano::app

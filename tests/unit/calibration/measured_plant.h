#pragma once

#include <cstddef>
#include <deque>

#include "telenano/master/calibration/dynamics_measurement.h"
#include "telenano/master/device/plant.h"

namespace telenano::calibration {

/// A simulated device that nobody holds.
inline device::PlantConfig free_device(double mass_kg, double damping_n_s_m, double friction_n,
                                       double quantum_m) {
  device::PlantConfig plant;
  plant.device_mass_kg = mass_kg;
  plant.device_damping_n_s_m = damping_n_s_m;
  plant.coulomb_friction_n = friction_n;
  plant.position_quantum_m = quantum_m;
  plant.grip_stiffness_n_m = plant.grip_damping_n_s_m = 0;
  return plant;
}

/// Measures a plant, `axes` of it; a force acts so many ticks after it was commanded. `each` is called every
/// tick with the plant and the time, before the device is read.
template <class Each>
DynamicsMeasurement measure(const device::PlantConfig& config, std::size_t late_ticks, double seconds,
                            const Each& each, int axes = 3) {
  device::Plant plant(config);
  plant.reset(Vec3(0.004, -0.002, 0.001));
  MeasurementConfig settings;
  settings.seconds_per_axis = seconds;
  DynamicsMeasurement measurement(settings);
  std::deque<Vec3> on_their_way(late_ticks, Vec3::Zero());
  device::DeviceReading reading;
  Vec3 hand_m = plant.pos_m();
  for (double time_s = 0; measurement.end() == MeasurementEnd::kRunning && measurement.axis() < axes;
       time_s += config.period_s) {
    each(time_s, reading, hand_m);
    reading.hand_pos_h_m = plant.encoder_pos_m();
    const Vec3 shown_n = plant.applied_force_n(measurement.force(CallTime::at(time_s), reading));
    measurement.applied(CallTime::at(time_s), shown_n);
    on_their_way.push_back(shown_n);
    plant.advance(on_their_way.front(), hand_m);
    on_their_way.pop_front();
  }
  return measurement;
}

inline DynamicsMeasurement measure(const device::PlantConfig& config, std::size_t late_ticks = 0,
                                   double seconds = 20) {
  return measure(config, late_ticks, seconds, [](double, device::DeviceReading&, Vec3&) {});
}

/// Its x axis alone.
inline DynamicsMeasurement measure_x(const device::PlantConfig& config, std::size_t late_ticks = 0) {
  return measure(
      config, late_ticks, 20, [](double, device::DeviceReading&, Vec3&) {}, 1);
}

}  // namespace telenano::calibration

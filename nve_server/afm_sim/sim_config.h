#pragma once

#include <cstdint>

#include "telenano/nve_server/nanonis/codec.h"

namespace telenano::afm_sim {

/// The rig that is simulated: everything but the sample and the probe, which the scene names.
struct SimConfig {
  // Piezo. Whole ranges, symmetric about 0.
  double range_xy_nm = 10000;
  double range_z_nm = 1000;
  int z_sign = 1;              ///< +1: larger Z is away from the sample
  double sample_z_nm = 0;      ///< away from the middle of the range where the tip touches, away positive
  double z_lag_s = 2e-4;       ///< of the piezo behind ZPosSet
  double creep = 0.003;        ///< part of a step that follows late
  double creep_s = 20;         ///< with this time constant
  double drift_x_nm_s = 0.03;  ///< of the tip over the sample
  double drift_y_nm_s = -0.02;
  double drift_z_nm_s = -0.05;  ///< negative: towards the sample
  // Signals.
  double deflection_nm_v = 50;        ///< signed: the photodiode's calibration
  double deflection_offset_nm = 1.5;  ///< of the free lever: a tare is needed
  double thermal_nm = 0.1;            ///< slow bending of the lever, peak
  double thermal_period_s = 300;
  double noise_nm_sqrt_hz = 5e-4;  ///< white, of the deflection
  double lateral_nn_v = 100;
  double lateral_noise_nn_sqrt_hz = 0.02;
  double quantum_v = 0;        ///< of the converter, 3.05e-4 for 16 bits over ±10 V; 0: none
  double signal_range_v = 10;  ///< a signal ends at plus and minus this
  // Controller.
  double acquisition_s = 0.005;
  double latency_s = 4e-4;  ///< of any reply, at least; at most three times this
  double switch_off_delay_s = 0.02;
  double tip_lift_nm = 0;
  double withdraw_nm_s = 5000;
  double approach_nm_s = 800;
  double setpoint_nn = 15;  ///< what ZCtrl.SetpntGet says as the deflection's signal, offset included
  double feedback_nm_s_nn = 20;
  nanonis::ErrorForm error_form = nanonis::ErrorForm::kZeroFilled;
  int safe_tip_signal = 8;      ///< index of the signal that SafeTip watches; negative: with the other sign
  bool restrict_roles = false;  ///< port k answers only what suits its role: motion, reads, data, emergency
  std::uint64_t seed = 1;
};

/// Indices of the simulated signals; the other names of the 32 are empty slots.
inline constexpr int kSignalCount = 32;
inline constexpr int kDeflectionSignal = 8;
inline constexpr int kLateralSignal = 9;
inline constexpr int kZSignal = 30;

/// What goes wrong with the photodiode or what reads it: the signal, the Z controller's feedback and SafeTip
/// see it.
enum class SensorFault : std::uint8_t {
  kNone,
  kFrozen,    ///< the last value, for ever
  kHighEnd,   ///< at the end of its range: the laser has left the photodiode
  kLowEnd,    ///< at the other one
  kNoisy,     ///< a hundred times the noise
  kInverted,  ///< about the value of the free lever: force away from the sample looks like force towards it
  kSwapped,   ///< with the lateral signal: volts of the one come as the other's
};

/// What becomes of a Withdraw that is answered as if it were carried out.
enum class WithdrawFault : std::uint8_t {
  kUndone,  ///< nothing moves, the status stays
  kHalf,    ///< it ends half way up
};

}  // namespace telenano::afm_sim

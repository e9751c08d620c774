#pragma once

#include <cstdint>
#include <vector>

#include "telenano/common/control/z_width.h"
#include "tests/studies/zwidth/sampled_loop.h"

namespace telenano::studies {

/// CB's experiment in the time domain: a one-sided wall, an encoder, a quantised force command, dry friction.
struct WallPlant {
  control::HapticDisplay display;
  control::VirtualDamper damper;
  double encoder_quantum_m = 0;  ///< 0: none
  double force_quantum_n = 0;    ///< 0: none
  double coulomb_friction_n = 0;
  double outside_damping_n_s_m = 0;  ///< virtual damper where the wall is not: negative eats the device's own
};

/// A hand that leans on the wall and tries to set it off: it pushes with a constant force and starts with a
/// blow.
struct PushingHand {
  Hand arm;
  double push_n = 0;
  double blow_m_s = 0;
};
/// The free device, and hands of 0.1 to 4 kg with resonances over the band, each leaning lightly and firmly.
std::vector<PushingHand> trying_hands(const control::HapticDisplay& display);

struct WallRun {
  double peak_to_peak_m = 0;        ///< over the last second
  double force_peak_to_peak_n = 0;  ///< of the wall's force, likewise
  std::int64_t steps = 0;
};
/// The hand at a wall of this stiffness, starting a tenth of a millimetre from rest: whatever swings more
/// than half a millimetre later has grown. It is watched for 4 s and 40 of the device's own time constants
/// 2m/b, at most 100 s: at a margin of 3 % of b the swing then grows by more than it needs to be seen. Ends
/// early when it diverges. `trace_m`, where given, gets the position of every sample, into the wall positive.
WallRun simulate_wall(const WallPlant& plant, double stiffness_n_m, const PushingHand& hand,
                      std::vector<double>* trace_m = nullptr);

/// Least stiffness, rising, at which some of the hands sees more than max(0.5 mm, 4 quanta) peak to peak over
/// the last second; found to 1 %. NaN if that is so at a hundredth of 2b/T already.
double simulated_stiffness(const WallPlant& plant, std::int64_t* steps = nullptr);

/// The firm push of trying_hands(), and what of its force a hand can tell (10 %): a limit cycle is felt when the
/// wall's force swings by more.
inline constexpr double kFirmPush_n = 10;
inline constexpr double kFeltSwing_n = 1;

/// Greatest virtual damping, rising by 5 %, of a wall of this stiffness at which no firm hand sees the swing of
/// simulated_stiffness() or feels one of kFeltSwing_n. `feels` false: only the first is asked. 0: none is.
double reachable_damping(const WallPlant& plant, double stiffness_n_m, bool feels);

}  // namespace telenano::studies

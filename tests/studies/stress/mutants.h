#pragma once

#include <memory>

#include "telenano/common/control/station_method.h"
#include "tests/studies/stress/run_spec.h"
#include "tests/support/virtual_hand.h"

namespace telenano::studies::stress {

/// Controllers that are wrong in ways in which they have been got wrong before; a suite that does not find
/// them out proves nothing. They exist here only: as methods that stand in for the station's, as devices (and what the station makes of them), as
/// slaves (wrong_slave.h), as twins (wrong_twin.h), as what is between server and station (wrong_wire.h: codec, session, reply gate), as
/// recorders (record_watch.h). Ten more, what a renderer shows, are in fidelity/renderer_mutants.h.
///
/// | name | what is wrong |
/// |---|---|
/// | wrong-index | accounts F(k)·v(k)·T, the force of the other end of the interval |
/// | credited-damping | what the device's damping takes is credited as if the hand had put it in |
/// | missing-epoch | a new epoch forgets the deficit: each restart grants an allowance |
/// | held-wave | a wave that did not come is the last one again |
/// | uncapped-damper | damping beyond b − KT/2 − \|B\| |
/// | no-clamp | the pre-commit clamp is not there |
/// | damper-after-clamp | the clamp is not last: the damper's force is added to what it has let through |
/// | half-velocity | the clamp reckons with half of v_max |
/// | free-tank | energy is sent to the slave and kept as well |
/// | sticky-force | device: a force that should go to zero stays |
/// | leap-on-resume | device: the first force after a pause comes hundredfold |
/// | double-force | device: twice what was commanded |
/// | slave-too-strong | slave: beyond its own force limit |
/// | falling-sums | slave: an energy sum that falls |
/// | slave-no-force | slave: no force |
/// | slave-half-force | slave: half of it |
/// | slave-late | slave: 100 ms late |
/// | slave-no-adhesion | slave: never pulls down |
/// | slave-no-friction | slave: nothing along the ground |
/// | slave-tilted | slave: turned by 10° about y |
/// | slave-reversed | slave: x the wrong way round |
/// | slave-swapped | slave: x for y |
/// | slave-low | slave: the ground 3 nm too low |
/// | slave-soft | slave: goes in 0.3 times as deep as it is told |
/// | slave-frozen | slave: says for ever what it said 0.3 s after touch |
/// | slave-leaky | slave: a force that stands still fades |
/// | slave-sticky | slave: pulls on for 0.2 s after it has let go |
/// | slave-coarse | slave: to the next 5 nN |
/// | slave-noisy | slave: 30 % of noise |
/// | slave-saturated | slave: at 20 nN it ends |
/// | slave-upside-down | slave: pushes where it should pull |
/// | forgiving-change | a change of scale forgets the deficit |
/// | generous-change | a change of scale grants an allowance of its own |
/// | slave-stiff | slave: pushes 1.3 times as hard as it should |
/// | slave-creeping | slave: the ground rises by 1 nm in a second |
/// | slave-blinking | slave: every half second no force for 30 ms |
/// | codec-swapped | codec: the force's x for its y |
/// | codec-unsigned | codec: the force without its sign |
/// | codec-short | codec: the force in piconewtons in 16 bits |
/// | codec-keeps-fields | codec: what is zero is not written, and the reader keeps what it had |
/// | session-old-news | session: every second reply has the force of one that came 60 replies earlier |
/// | session-one-epoch | session: a server that has begun anew says the old epoch |
/// | session-deaf | session: after an outage nothing is heard any more |
/// | record-late | recorder: position and force of the tick before |
/// | record-rendered | recorder: the force that the method wanted for the one that acted |
/// | record-gaps | recorder: every 500th row is missing |
/// | record-single | recorder: positions in single precision |
/// | record-swapped | recorder: x for z |
/// | gate-creeping | reply gate: compares with the reply before, sent or not, and so leaves out a slow rise |
/// | gate-silent | reply gate: no longest time between two replies |
/// | gate-forgetful | reply gate: the energy of what was left out is not in the next reply |
/// | gate-blind | reply gate: leaves out another contact state |
/// | slave-holds-on | slave: does not withdraw, whatever the server says |
/// | slave-drifts | slave: adds up the velocities it is told, so that what is lost is lost |
/// | slave-gives-uncounted | slave: says a tenth less than the energy that it gives |
/// | slave-takes-uncounted | slave: says a tenth more than the energy that it takes |
/// | twin-half | twin: half of the force |
/// | twin-late | twin: 20 ms late |
/// | twin-no-friction | twin: nothing along the ground |
/// | twin-one-way | twin: on the way out 1.3 times as strong, so that it gives energy |
/// | record-energy | recorder: the hand's energy without the sign of what came out |
/// | record-force | recorder: the sample's force a thousandth too large, x the wrong way round |
/// | station-holds-clutch | station: follows the hand and pushes it while the clutch is held |
/// | station-holds-stop | station: goes on when it is stopped |
/// | station-far | station: leads the tip a tenth further than it should |
/// | station-swapped | station: x for y of the hand |
/// | station-old-scale | station: another scale is said to be in use, and is not |
/// | station-old-force | station: another scale of motions is, that of forces is not |
/// | station-too-stiff | station: accepts any scale, passive or not |
/// | slave-slow | slave: withdraws at a fiftieth of its speed |
/// | command-coarse | station: three times the deadband of commands |
/// | command-late | station: five times the longest time between two commands |
/// | slave-goes-back | slave: every 50th step goes to where the last but one had led |
/// | station-no-trip | station: knows no hand that is too fast |
/// | ks-half, clamp-half, tdpa-half, wave-half | `ks`, `ks-clamp`, `tdpa`, `wave`: half of the force |
struct MutantInfo {
  Mutant mutant = Mutant::kNone;
  control::Method method = control::Method::kModel;  ///< that it is made from
};
MutantInfo mutant_info(Mutant mutant) noexcept;

/// The wrong method that stands in for `spec.method`; null where the station's own is right.
std::unique_ptr<control::StationMethod> make_mutant_method(const RunSpec& spec);

/// `device`, or a wrong one around it.
std::shared_ptr<support::VirtualHand> with_mutant(std::shared_ptr<support::VirtualHand> device,
                                                  Mutant mutant);

}  // namespace telenano::studies::stress

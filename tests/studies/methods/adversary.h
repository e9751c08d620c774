#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "telenano/common/control/method.h"
#include "tests/support/accounted_hand.h"

namespace telenano::studies {

/// Hands that mean harm, against the whole system with a wall behind it. No hand that stays below v_max may
/// get more out of its port than the allowances E₀, one a side, beyond what the device certainly loses — if
/// the method promises that.

/// What the link does besides its delay.
enum class Channel : std::uint8_t {
  kIdeal,
  kJitter,    ///< up to half of the delay more each way (at least 2 ms), reordered; duplicates
  kBursts,    ///< nothing gets through for 20 ms at a time, a fifth of the time, each way
  kSpite,     ///< drops with knowledge of the hand: while the force goes with its motion no news gets through
  kRestarts,  ///< the server dies and comes again, at random times
  kEverything  ///< jitter, bursts and restarts
};
inline constexpr Channel kChannels[] = {Channel::kIdeal, Channel::kJitter,   Channel::kBursts,
                                        Channel::kSpite, Channel::kRestarts, Channel::kEverything};
const char* channel_name(Channel channel) noexcept;

struct AttackConfig {
  control::Method method = control::Method::kKsClamp;
  double rtt_s = 0;
  Channel channel = Channel::kIdeal;
  double wall_n_m = 1000;       ///< as it would be felt at the hand
  double clearance_m = 0.005;   ///< of the hand above the wall at the start
  double seconds = 3;           ///< of the attack, six round trips besides
  double restart_mean_s = 0.8;  ///< between restarts, and ten round trips besides: a handshake takes some
  double allowance_j = 0.010;   ///< E₀ of each side
  support::AccountedHandConfig hand{};
  std::uint64_t seed = 1;

  std::int64_t ticks() const;
};

struct AttackOutcome {
  double extracted_j = 0;      ///< most ever, beyond the device's certain loss
  double given_j = 0;          ///< most ever that the port had given, net
  double generated_j = 0;      ///< most ever that hand and wall together had got: made between them
  double quantum_bound_j = 0;  ///< Q, what the encoder may hide from any account; 0 without a quantum
  bool stopped = false;        ///< the station latched a stop
  bool limits_kept = true;     ///< force finite, within the force limit and its slew; energy sums never fall
  bool too_fast = false;       ///< the hand was faster than v_max: what came afterwards does not count
  std::int64_t steps = 0;
};

AttackOutcome attack(const AttackConfig& config, const std::shared_ptr<support::AccountedHand>& hand);

/// A hand by name, made anew for every attack.
struct NamedHand {
  std::string name;
  std::shared_ptr<support::AccountedHand> (*make)(const AttackConfig&, double a, double b);
  double a = 0;
  double b = 0;
};

/// Sines, squares, telegraphs, hands that go with the force, and passive masses and springs with resonances
/// up to nine tenths of Nyquist's frequency. `every`: only each n-th of a family, 1 all.
std::vector<NamedHand> named_hands(const AttackConfig& config, int every);

/// The worst that was found for a method, a round trip and a channel.
struct WorstAttack {
  AttackConfig config;
  AttackOutcome outcome;
  std::string hand;
  std::int64_t attacks = 0;
  std::int64_t stopped = 0;  ///< of these the station ended by a latched stop, climbing apart
  std::int64_t steps = 0;
  double generated_j = 0;   ///< most in any attack
  bool limits_kept = true;  ///< in every attack
};

/// Hill climbing over what the hand does: a path through points `knot_s` apart, of which some are changed;
/// the change stays if it got more out. Begins with `start_m` (samples of a path).
struct Climbed {
  AttackOutcome outcome;
  std::vector<double> knots_m;
  std::int64_t steps = 0;
};
Climbed climb(const AttackConfig& config, double knot_s, int tries, const std::vector<double>& start_m);

struct AttackEffort {
  double seconds = 3;
  int every = 1;          ///< of the named hands
  int climb_tries = 100;  ///< each of the two climbs
};

/// All named hands, then hill climbing from the path of the best of them, point by sample (white) and with
/// points 25 ms apart (below 20 Hz).
WorstAttack worst_attack(const AttackConfig& config, const AttackEffort& effort);

/// 2 E₀. (The environment's own energy can only fall from zero at the start, and these hands have no
/// quantum.)
double promised_bound_j(const AttackConfig& config);

/// Does the method account for energy at both ports, so that it makes none but two allowances between them
/// as long as commands come one after the other?
bool balances_both_ports(control::Method method) noexcept;

}  // namespace telenano::studies

#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <string_view>

#include "telenano/common/base/vec3.h"
#include "telenano/common/link/messages.h"
#include "telenano/common/rt/latest_value.h"

namespace telenano::afm {

/// Frame W of an AFM: x and y as the piezo's, from where the tip stood at the start; z = 0 the surface there,
/// drift taken out. Positions are those of the lever's base: of the apex, if no force acts.

/// What the port wants, from the server's loop to the controller's thread.
struct PortTarget {
  std::int64_t time_ns = 0;   ///< of the last step: its age says whether there is still a session
  std::uint64_t session = 0;  ///< counts the slaves that were told anything; 0: none yet
  std::uint64_t clears = 0;   ///< counts the times that an operator cleared the latch
  Vec3 target_w_nm = Vec3::Zero();
  bool follow = false;
  bool retract = false;
  bool wanted = false;  ///< an operator wants to engage: a withdrawn tip may come back
};

enum class Phase : std::uint8_t {
  kChecking,   ///< asking, nothing moves
  kRefused,    ///< something is wrong with the rig or its configuration
  kEngaging,   ///< the Z controller brings the tip to the surface
  kLifting,    ///< switched off, lifted
  kTaring,     ///< reading the force in free space
  kTouching,   ///< down and up by direct Z, to know the surface
  kFollowing,  ///< the port moves the tip
  kWithdrawing,
  kWithdrawn
};

/// On its way to the surface, by itself.
constexpr bool approaching(Phase phase) noexcept {
  return phase == Phase::kEngaging || phase == Phase::kLifting || phase == Phase::kTaring ||
         phase == Phase::kTouching;
}

/// Why the tip was withdrawn.
enum class Cause : std::uint8_t {
  kNone,
  kParked,  ///< no session for long: not latched
  kLinkLoss,
  kStop,
  kForceLimit,
  kLateralLimit,
  kController,  ///< an error reply, or a state of the controller that nobody asked for
  kConnection,  ///< a connection was reset, or a reply was none
  kSilent,      ///< a reply did not come
  kStaleForce,
  kSafeTip,    ///< the controller withdrew by itself
  kNoSurface,  ///< the approach found none
  kExit,
  kNotApproved,  ///< the last server did not end with the tip withdrawn, and nobody has approved an approach
  kSignal        ///< the deflection's signal is not that of a live sensor
};
std::string_view name(Phase phase) noexcept;
std::string_view name(Cause cause) noexcept;

/// What is known, from the controller's thread to the server's loop.
struct PortState {
  std::int64_t time_ns = 0;
  Phase phase = Phase::kChecking;
  Cause cause = Cause::kNone;     ///< while withdrawing or withdrawn
  std::uint64_t latches = 0;      ///< counts the withdrawals that an operator must clear
  Vec3 base_w_nm = Vec3::Zero();  ///< as last sent
  Vec3 measured_base_w_nm = Vec3::Zero();
  Vec3 measured_force_w_nn = Vec3::Zero();
  std::int64_t measured_ns = 0;  ///< middle of the averaging
  bool force_known = false;
  bool touching = false;
  bool held_by_force = false;  ///< the force limit holds the tip back
  link::LocalModel model;
  double noise_nn = 0;
  double surface_bound_nm = 0;  ///< of W's zero: within this in 95 % of all times
  double drift_nm_s = 0;        ///< of the piezo's height at which the tip touches
  double drift_bound_nm_s = 0;
  double energy_in_aj = 0;
  double energy_out_aj = 0;
  double energy_bound_aj = 0;
};

/// Both, between one loop and one thread that never wait for each other.
class AfmExchange {
 public:
  void store_wish(const PortTarget& wish) noexcept;
  bool load_wish(PortTarget& wish) const noexcept;
  void store_state(const PortState& state) noexcept;
  bool load_state(PortState& state) const noexcept;

  std::uint64_t next_session() noexcept { return sessions_.fetch_add(1, std::memory_order_relaxed) + 1; }
  std::uint64_t clear() noexcept { return clears_.fetch_add(1, std::memory_order_relaxed) + 1; }
  std::uint64_t clears() const noexcept { return clears_.load(std::memory_order_relaxed); }

 private:
  // Vec3 is not trivially copyable: the same as plain numbers.
  using Triple = std::array<double, 3>;
  struct PlainWish {
    std::int64_t time_ns;
    std::uint64_t session, clears;
    Triple target;
    std::uint8_t follow, retract, wanted;
  };
  struct PlainState {
    std::int64_t time_ns, measured_ns;
    std::uint64_t latches;
    Triple base, measured_base, measured_force, point, normal;
    std::array<double, 11> numbers;
    std::uint32_t version;
    std::uint8_t phase, cause, force_known, touching, held_by_force;
  };
  static Triple plain(const Vec3& v) noexcept { return {v.x(), v.y(), v.z()}; }
  static Vec3 vector(const Triple& t) noexcept { return {t[0], t[1], t[2]}; }

  rt::LatestValue<PlainWish> wish_;
  rt::LatestValue<PlainState> state_;
  std::atomic<std::uint64_t> sessions_{0};
  std::atomic<std::uint64_t> clears_{0};
};

}  // namespace telenano::afm

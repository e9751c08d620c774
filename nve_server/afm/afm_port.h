#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace telenano::afm {

/// The connections on which the logic talks, each strictly request and reply. A controller with fewer of them
/// serves several on one; an answer then comes later, and the logic counts its age from the request.
enum class Role : std::uint8_t { kMotion, kReads, kData, kEmergency };
inline constexpr std::size_t kRoles = 4;
std::string_view name(Role role) noexcept;

/// What an AFM can be told and asked, whatever its controller. Heights are in nm along the sample's normal,
/// away from the sample positive, 0 in the middle of the piezo's range; x and y are the piezo's, in nm.
enum class AfmOp : std::uint8_t {
  kSetup,  ///< {step}: of the adapter's own start. Nothing moves. What the answer says, it says by its kind
  kGiveBack,  ///< {step}: of giving the controller the settings back that it had
  kRead,      ///< -> kSignals, averaged over one period of force_rate_hz
  kMoveZ,     ///< {height}; while the feedback is off -> kDone
  kMoveXy,    ///< {x, y} -> kDone
  kFeedback,  ///< {1 on: the tip goes to the surface and stays there; 0 off: it is lifted, then stands still}.
  ///< Where the controller does not lift by itself, the adapter does so in answers to kAskFeedback,
  ///< and says 0 when the tip is up
  kAskFeedback,  ///< -> kFeedback
  kAskHeight,    ///< -> kHeight
  kAskStatus,    ///< -> kStatus
  kAskSetpoint,  ///< -> kSetpoint
  kAskWatched,   ///< -> kWatched. Only with AfmCapabilities::watches_force
  kAskHeld,      ///< {i}: what the start found or set is still so: `unfit` where not -> kDone
  kFloor,        ///< {height}: no command goes below it. Only with AfmCapabilities::z_limits -> kDone
  kWithdraw,     ///< as far up as it goes, feedback off -> kDone, at once, or when it is up
  kStop          ///< any motion across -> kDone. Where there is no such command: a move to where the tip is
};

struct AfmCommand {
  AfmOp op = AfmOp::kStop;
  std::array<double, 2> numbers{};
  std::size_t step() const noexcept { return static_cast<std::size_t>(numbers[0]); }
  bool operator==(const AfmCommand&) const = default;
};

enum class AfmStatus : std::uint8_t {
  kOff,        ///< the feedback is off: the height is that of the last command
  kProtected,  ///< the controller has withdrawn the tip by itself
  kOther       ///< on, or on its way
};

enum class ReadingKind : std::uint8_t {
  kDone,
  kRange,     ///< across (the lesser of x and y), along Z: the piezo's, in nm
  kStatus,    ///< the controller's own number, for messages; and `status`
  kHeight,    ///< of the lever's base
  kPlace,     ///< x, y of it
  kSignals,   ///< deflection and lateral, volts of the detector; deflection in nm, away from the sample
              ///< positive, not tared; lateral force in nN
  kSetpoint,  ///< in the controller's unit, for messages; as a deflection in nm
  kWatched,   ///< what the controller's own protection sees, in the unit of AfmPort::signal_of
  kFeedback   ///< 1 on, 0 off and lifted
};

/// An answer.
struct AfmReading {
  ReadingKind kind = ReadingKind::kDone;
  std::array<double, 4> numbers{};
  AfmStatus status = AfmStatus::kOther;
  std::string refused;  ///< the request that the controller did not take, by its own name; empty: it did
  std::string why;      ///< and what it says about it
  std::string unfit;    ///< of a step of the start, or kAskHeld: one line on what is wrong with the rig
};

/// What an adapter's controller has. The logic does without what is missing, and says so in SAFETY.md's
/// words.
struct AfmCapabilities {
  bool z_limits = false;       ///< holds commands above a floor
  bool watches_force = false;  ///< withdraws by itself at a force, and tells what it watches
};

/// Between AfmLogic, which decides, and one kind of controller: translates commands into bytes and bytes into
/// readings. No socket, clock or thread: whoever has the connections passes the bytes on. A value (clone()).
/// Its answers must be those of the requests, in order. Whether an adapter keeps to all of this is what the
/// conformance suite asks (tests/unit/afm/port_conformance.h).
class AfmPort {
 public:
  enum class Next : std::uint8_t { kNeedMore, kReading, kBroken };

  virtual ~AfmPort() = default;
  virtual std::unique_ptr<AfmPort> clone() const = 0;
  virtual AfmCapabilities capabilities() const noexcept = 0;

  /// The start: these steps in this order, each after the answer to the last. Together they must tell the
  /// range, the status, the height, the place, the signals twenty times, the set point, and, where there is
  /// one, what the controller's protection watches.
  virtual std::size_t setup_steps() const noexcept = 0;
  virtual Role setup_role(std::size_t step) const noexcept = 0;
  /// Known when the steps of the start have been answered; fewer after a start that was broken off.
  virtual std::size_t give_back_steps() const noexcept = 0;
  virtual Role give_back_role(std::size_t step) const noexcept = 0;
  /// What somebody else may change while the tip is out, and must not: asked one after another (kAskHeld) on
  /// the data connection.
  virtual std::size_t held_settings() const noexcept { return 0; }

  /// The request's bytes; its answer is then expected on that connection.
  virtual std::vector<std::uint8_t> encode(Role role, const AfmCommand& command) = 0;
  virtual void feed(Role role, std::span<const std::uint8_t> bytes) = 0;
  /// kBroken: what came is not this protocol, or not an answer to what was asked.
  virtual Next next(Role role, AfmReading& reading) = 0;
  /// The connection is a new one, or what it still waits for does not count any more.
  virtual void reset(Role role) = 0;

  /// Whether the answer may wait for a whole period of averaging.
  virtual bool averages(const AfmCommand& command) const noexcept = 0;
  /// The controller's own number for a deflection, in nm: what its protection compares.
  virtual double signal_of(double deflection_nm) const noexcept = 0;
};

/// An adapter as a value.
class PortHandle {
 public:
  explicit PortHandle(std::unique_ptr<AfmPort> port) : port_(std::move(port)) {}
  PortHandle(const PortHandle& other) : port_(other.port_->clone()) {}
  PortHandle& operator=(const PortHandle& other) {
    if (this != &other) port_ = other.port_->clone();
    return *this;
  }
  PortHandle(PortHandle&&) noexcept = default;
  PortHandle& operator=(PortHandle&&) noexcept = default;
  ~PortHandle() = default;
  AfmPort* operator->() const noexcept { return port_.get(); }
  AfmPort& operator*() const noexcept { return *port_; }

 private:
  std::unique_ptr<AfmPort> port_;
};

}  // namespace telenano::afm

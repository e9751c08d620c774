#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <span>

#include "telenano/common/base/random.h"
#include "telenano/common/rt/clock.h"
#include "telenano/nve_server/afm/afm_logic.h"
#include "telenano/nve_server/afm/afm_slave.h"
#include "telenano/nve_server/afm_sim/sim_controller.h"
#include "telenano/nve_server/afm_sim/sim_faults.h"

namespace telenano::support {

/// An AFM slave's logic and a simulated controller, with four serial connections between them as bytes, in
/// virtual time. What the real programs do over TCP, but for the kernel. A value: a copy goes on alike.
class VirtualAfm {
 public:
  VirtualAfm(const afm::AfmConfig& config, const afm_sim::SimConfig& rig,
             std::shared_ptr<const scene::Scene> scene, std::uint64_t seed = 1);

  /// Until then, in steps of kStepNs.
  void advance_to(std::int64_t now_ns, const afm::PortTarget& wish);
  void apply(const afm_sim::Fault& fault);
  /// From now on the answers of one connection come so much later than the controller gave them: whoever
  /// passes them on is kept waiting.
  void delay_answers(afm::Role role, std::int64_t delay_ns) {
    channels_[static_cast<std::size_t>(role)].delay_ns = delay_ns;
  }
  /// The server's process dies. What it has sent is still on its way; the guard sees it within kGuardNs.
  void kill_server() { killed_ns_ = now_ns_; }
  /// All connections are cut and none can be made for so long; the guard's as well.
  void cut(std::int64_t length_ns);

  std::int64_t now_ns() const noexcept { return now_ns_; }
  afm::AfmLogic& logic() noexcept { return logic_; }
  const afm::AfmLogic& logic() const noexcept { return logic_; }
  afm_sim::SimController& controller() noexcept { return sim_; }
  const afm_sim::SimController& controller() const noexcept { return sim_; }
  std::uint64_t calls(nanonis::CommandId id) const { return calls_[static_cast<std::size_t>(id)]; }
  /// FNV-1a of all that the logic has sent: time, connection and every byte, in order. The same conversation,
  /// the same number.
  std::uint64_t conversation() const noexcept { return conversation_; }
  std::uint64_t requests() const noexcept { return requests_; }
  /// Can what is sent now be heard?
  bool reachable() const noexcept { return now_ns_ >= silent_until_ns_ && now_ns_ >= cut_until_ns_; }

  static constexpr std::int64_t kStepNs = 500'000;
  static constexpr std::int64_t kReconnectNs = 20'000'000;
  static constexpr std::int64_t kGuardNs = 5'000'000;

 private:
  struct Channel {
    bool open = false;
    std::int64_t reconnect_ns = 0;
    std::deque<nanonis::Call> inbox;
    std::optional<afm_sim::SimController::Pending> pending;
    bool garbage = false;
    std::int64_t delay_ns = 0;
    std::optional<nanonis::Bytes> answer;  // on its way
    std::int64_t answer_ns = 0;
  };
  void step(const afm::PortTarget& wish);
  void close(std::size_t i);
  void serve(std::size_t i);
  void hand_over(std::size_t i);
  void record(std::size_t i, std::span<const std::uint8_t> bytes) noexcept;

  afm::AfmLogic logic_;
  afm_sim::SimController sim_;
  std::array<Channel, afm::kRoles> channels_;
  std::deque<nanonis::Call> orphans_;  // sent by connections that are gone, not yet read by the controller
  Random random_;
  std::int64_t now_ns_ = 0;
  std::int64_t silent_until_ns_ = 0;
  std::int64_t slow_until_ns_ = 0;
  std::int64_t slow_ns_ = 0;
  std::int64_t cut_until_ns_ = 0;
  std::int64_t killed_ns_ = -1;
  bool guard_done_ = false;
  std::uint64_t conversation_ = 0xcbf29ce484222325;
  std::uint64_t requests_ = 0;
  std::array<std::uint64_t, nanonis::kCommandCount> calls_{};
};

}  // namespace telenano::support

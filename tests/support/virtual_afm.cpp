#include "tests/support/virtual_afm.h"

#include <stdexcept>
#include <utility>

#include "telenano/nve_server/afm/afm_adapters.h"
#include "telenano/nve_server/nanonis/frame_reader.h"

namespace telenano::support {

using afm::Role;

namespace {

nanonis::Call decoded(std::span<const std::uint8_t> bytes) {
  nanonis::FrameReader reader;
  reader.feed(bytes);
  nanonis::Header header;
  std::span<const std::uint8_t> body;
  nanonis::Call call;
  reader.next(header, body);
  const nanonis::Command* const command = nanonis::find_command(header.name);
  if (command == nullptr || !nanonis::decode_call(*command, body, call))
    throw std::runtime_error("a request that is none: " + header.name);
  return call;
}

}  // namespace

VirtualAfm::VirtualAfm(const afm::AfmConfig& config, const afm_sim::SimConfig& rig,
                       std::shared_ptr<const scene::Scene> scene, std::uint64_t seed)
    : logic_(config, afm::make_adapter("nanonis", config)), sim_(rig, std::move(scene)), random_(seed) {}

void VirtualAfm::close(std::size_t i) {
  Channel& c = channels_[i];
  orphans_.insert(orphans_.end(), c.inbox.begin(), c.inbox.end());
  const bool garbage = c.garbage;
  const std::int64_t delay_ns = c.delay_ns;
  c = {};
  c.garbage = garbage;
  c.delay_ns = delay_ns;
  c.reconnect_ns = now_ns_ + kReconnectNs;
}

void VirtualAfm::cut(std::int64_t length_ns) {
  cut_until_ns_ = now_ns_ + length_ns;
  for (std::size_t i = 0; i < channels_.size(); ++i) {
    close(i);
    logic_.lost(static_cast<Role>(i), afm::Loss::kClosed, now_ns_);
  }
  orphans_.clear();  // what was on the wire is gone
}

void VirtualAfm::apply(const afm_sim::Fault& fault) {
  switch (fault.kind) {
    case afm_sim::FaultKind::kSilent:
      silent_until_ns_ = now_ns_ + fault.length_ns;
      return;
    case afm_sim::FaultKind::kSlow:
      slow_until_ns_ = now_ns_ + fault.length_ns;
      slow_ns_ = fault.delay_ns;
      return;
    case afm_sim::FaultKind::kGarbage:
      for (Channel& c : channels_) c.garbage = true;
      return;
    case afm_sim::FaultKind::kSensor:
      sim_.set_sensor_fault(fault.sensor);
      return;
    case afm_sim::FaultKind::kWithdraw:
      sim_.set_withdraw_fault(fault.withdraw, fault.count);
      return;
    case afm_sim::FaultKind::kDip:
      sim_.dip(fault.depth_nm, fault.length_ns);
      return;
    case afm_sim::FaultKind::kReset:
      for (std::size_t i = 0; i < channels_.size(); ++i) {
        close(i);
        logic_.lost(static_cast<Role>(i), afm::Loss::kClosed, now_ns_);
      }
  }
}

void VirtualAfm::record(std::size_t i, std::span<const std::uint8_t> bytes) noexcept {
  const auto mix = [this](std::uint8_t byte) { conversation_ = (conversation_ ^ byte) * 0x100000001b3; };
  ++requests_;
  for (int shift = 0; shift < 64; shift += 8) mix(static_cast<std::uint8_t>(now_ns_ >> shift));
  mix(static_cast<std::uint8_t>(i));
  for (const std::uint8_t byte : bytes) mix(byte);
}

void VirtualAfm::serve(std::size_t i) {
  Channel& c = channels_[i];
  if (c.answer) {
    if (now_ns_ < c.answer_ns) return;
    hand_over(i);
  }
  if (!c.pending) {
    if (c.inbox.empty()) return;
    const nanonis::Call call = c.inbox.front();
    c.inbox.pop_front();
    ++calls_[static_cast<std::size_t>(call.id)];
    c.pending = sim_.begin(call, static_cast<int>(i), now_ns_);
    if (now_ns_ < slow_until_ns_) c.pending->ready_ns += slow_ns_;
  }
  if (!sim_.finish(*c.pending, now_ns_)) return;
  const nanonis::Command& command = nanonis::command(c.pending->call.id);
  nanonis::Bytes bytes = nanonis::encode_answer(command, c.pending->answer, sim_.config().error_form);
  c.pending.reset();
  if (c.garbage) {
    for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random_.bits());
    c.garbage = false;
  }
  c.answer = std::move(bytes);
  c.answer_ns = now_ns_ + c.delay_ns;
  if (c.delay_ns == 0) hand_over(i);
}

void VirtualAfm::hand_over(std::size_t i) {
  const nanonis::Bytes bytes = *std::exchange(channels_[i].answer, std::nullopt);
  if (killed_ns_ >= 0) return;
  const Role role = static_cast<Role>(i);
  logic_.port().feed(role, bytes);
  afm::AfmReading reading;
  switch (logic_.port().next(role, reading)) {
    case afm::AfmPort::Next::kReading:
      return logic_.answered(role, reading, now_ns_);
    case afm::AfmPort::Next::kNeedMore:
      return;
    case afm::AfmPort::Next::kBroken:
      close(i);
      logic_.lost(role, afm::Loss::kGarbage, now_ns_);
  }
}

void VirtualAfm::step(const afm::PortTarget& wish) {
  now_ns_ += kStepNs;
  sim_.advance_to(now_ns_);
  const bool alive = killed_ns_ < 0;
  if (alive) {
    logic_.tick(now_ns_, wish);
    for (std::size_t i = 0; i < channels_.size(); ++i) {
      const Role role = static_cast<Role>(i);
      if (logic_.take_close(role)) close(i);
      Channel& c = channels_[i];
      if (!c.open && now_ns_ >= c.reconnect_ns && now_ns_ >= cut_until_ns_) {
        c.open = true;
        logic_.connected(role, now_ns_);
      }
      afm::AfmCommand command;
      if (c.open && logic_.next(role, now_ns_, command)) {
        const auto bytes = logic_.port().encode(role, command);
        record(i, bytes);
        c.inbox.push_back(decoded(bytes));
      }
    }
  } else if (!guard_done_ && now_ns_ > killed_ns_ + kGuardNs && reachable()) {
    // As guard.cpp does: the floor first.
    const double end_m = 0.5e-9 * sim_.config().range_z_nm, up_m = 0.9 * end_m - 1e-9;
    const bool away = sim_.config().z_sign > 0;
    sim_.begin({nanonis::CommandId::kLimitsEnabledSet, {1}}, 3, now_ns_);
    sim_.begin({nanonis::CommandId::kLimitsSet, {away ? end_m : -up_m, away ? up_m : -end_m}}, 3, now_ns_);
    sim_.begin({nanonis::CommandId::kWithdraw, {0, -1}}, 3, now_ns_);
    guard_done_ = true;
  }
  if (!reachable()) return;
  // After a silence the controller reads its sockets in any order, those of the dead included.
  while (!orphans_.empty() && random_.chance(0.5)) {
    sim_.begin(orphans_.front(), -1, now_ns_);
    orphans_.pop_front();
  }
  const std::size_t first = random_.below(channels_.size());
  for (std::size_t k = 0; k < channels_.size(); ++k) serve((first + k) % channels_.size());
}

void VirtualAfm::advance_to(std::int64_t until_ns, const afm::PortTarget& wish) {
  while (now_ns_ < until_ns) step(wish);
}

}  // namespace telenano::support

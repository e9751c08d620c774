#include "telenano/common/net/practice_link.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstring>

#include "telenano/common/base/error.h"

namespace telenano::net {
namespace {

constexpr double kNsPerMs = 1e6;

[[noreturn]] void refuse(const std::string& flag, const std::string& text) {
  throw UserError(
      flag + " " + text +
      ": expected off, or some of rtt=0 to 2000 (ms), jitter=0 to 500 (ms), loss=0 to 50 (percent), "
      "with commas between");
}

}  // namespace

PracticeLink parse_practice_link(const std::string& text, const std::string& flag) {
  PracticeLink link;
  if (text == "off" || text == "0") return link;
  if (text.empty()) refuse(flag, "''");
  for (std::size_t at = 0; at <= text.size();) {
    const std::size_t end = std::min(text.find(',', at), text.size());
    const std::string part = text.substr(at, end - at);
    at = end + 1;
    const std::size_t equals = part.find('=');
    if (equals == std::string::npos) refuse(flag, text);
    double value = 0;
    const char* const last = part.data() + part.size();
    const auto [rest, error] = std::from_chars(part.data() + equals + 1, last, value);
    if (error != std::errc{} || rest != last || !(value >= 0)) refuse(flag, text);
    const std::string key = part.substr(0, equals);
    if (key == "rtt" && value <= kPracticeRttMost_ms) {
      link.rtt_ms = value;
    } else if (key == "jitter" && value <= kPracticeJitterMost_ms) {
      link.jitter_ms = value;
    } else if (key == "loss" && value <= 100 * kPracticeLossMost) {
      link.loss = value / 100;
    } else {
      refuse(flag, text);
    }
  }
  return link;
}

std::string practice_text(const PracticeLink& link) {
  std::string text;
  char part[48];
  const auto add = [&](const char* form, double value) {
    if (!(value > 0)) return;
    std::snprintf(part, sizeof part, form, value);
    text += (text.empty() ? "" : ", ") + std::string(part);
  };
  add("+%.0f ms", link.rtt_ms);
  add("jitter %.0f ms", link.jitter_ms);
  add("%.1f %% lost", 100 * link.loss);
  return text;
}

ImpairmentConfig PracticeDatagram::impairment_of(const PracticeLink& link) {
  ImpairmentConfig config;
  config.delay_ns = std::llround(0.5 * kNsPerMs * link.rtt_ms);
  config.jitter_ns = std::llround(kNsPerMs * link.jitter_ms);
  config.jitter = ImpairmentConfig::Jitter::kHalfNormal;
  config.loss = link.loss;
  return config;
}

PracticeDatagram::PracticeDatagram(Datagram& inner, Clock clock, const PracticeLink& link, std::uint64_t seed)
    : inner_(inner),
      clock_(clock),
      began_ns_(clock()),
      up_(impairment_of(link), seed),
      down_(impairment_of(link), seed + 1),
      going_(kCapacity, kSlotBytes),
      coming_(kCapacity, kSlotBytes),
      coming_from_(kCapacity),
      buffer_(kSlotBytes) {}

void PracticeDatagram::set(const PracticeLink& link) noexcept {
  for (Impairment* const way : {&up_, &down_}) {
    way->config.delay_ns = std::llround(0.5 * kNsPerMs * link.rtt_ms);
    way->config.jitter_ns = std::llround(kNsPerMs * link.jitter_ms);
    way->config.loss = link.loss;
  }
}

void PracticeDatagram::move_on(std::int64_t now) noexcept {
  for (; going_.next_arrival_ns() <= now; going_.pop()) inner_.send(going_.front().bytes, to_);
  inner_.flush();
  Received received;
  while (coming_.room() > 1 && inner_.receive(buffer_, received)) {
    // What is cut is of no use to anybody.
    if (received.size > buffer_.size()) continue;
    // From when it reached this machine on, not from when somebody looked.
    came_ns_ = std::max(came_ns_, now - received.age_ns);
    const Fate fate = down_.send(received.size, came_ns_, coming_.room() - 1);
    for (std::size_t i = 0; i < fate.n; ++i) {
      coming_from_[came_ % kCapacity] = received;
      coming_.put(std::span(buffer_).first(received.size), fate.copies[i], came_++ % kCapacity);
    }
  }
}

SendStatus PracticeDatagram::send(std::span<const std::uint8_t> bytes, const Address& to) noexcept {
  const std::int64_t now = now_ns();
  to_ = to;
  if (bytes.size() > kSlotBytes) return SendStatus::kFailed;
  const Fate fate = up_.send(bytes.size(), now, going_.room());
  for (std::size_t i = 0; i < fate.n; ++i) going_.put(bytes, fate.copies[i]);
  move_on(now);
  return SendStatus::kSent;
}

bool PracticeDatagram::receive(std::span<std::uint8_t> buffer, Received& received) noexcept {
  const std::int64_t now = now_ns();
  move_on(now);
  if (coming_.next_arrival_ns() > now) return false;
  const DelayLine::Item item = coming_.front();
  received = coming_from_[item.tag];
  received.size = item.size;
  received.age_ns = now - item.arrival_ns;
  std::memcpy(buffer.data(), item.bytes.data(), std::min(buffer.size(), item.bytes.size()));
  coming_.pop();
  return true;
}

void PracticeDatagram::flush() noexcept {
  move_on(now_ns());
}

}  // namespace telenano::net

#include "telenano/master/device/hid/hid_reader.h"

#include <utility>

#include "telenano/master/device/hid/pedal_reports.h"

namespace telenano::device {
namespace {

constexpr int kTimeoutMs = 50;          // for a stop to be heard; reports end the wait at once
constexpr std::size_t kReportMax = 64;  // a full-speed interrupt transfer

void count_presses(std::uint32_t before, HidNews& news) noexcept {
  const std::uint32_t pressed = news.puck.buttons & ~before;
  for (std::size_t i = 0; i < news.presses.size(); ++i) news.presses[i] += (pressed >> i) & 1u;
}

}  // namespace

void take_puck_report(std::span<const std::uint8_t> report, HidNews& news) noexcept {
  const std::uint32_t before = news.puck.buttons;
  const PuckReport kind = parse_puck_report(report, news.puck);
  if (kind == PuckReport::kUnknown) {
    ++news.unknown;
    return;
  }
  if (kind != PuckReport::kButtons) ++news.reports;
  count_presses(before, news);
}

void take_pedal_report(std::span<const std::uint8_t> report, HidNews& news) noexcept {
  const std::uint32_t before = news.puck.buttons;
  news.puck.buttons = pedal_buttons(report);
  count_presses(before, news);
}

bool pressed_since(const HidNews& last, const HidNews& now, std::uint32_t mask) noexcept {
  for (std::size_t i = 0; i < now.presses.size(); ++i) {
    if (((mask >> i) & 1u) != 0 && now.presses[i] != last.presses[i]) return true;
  }
  return false;
}

HidReader::HidReader(std::unique_ptr<HidPort> port, Take take)
    : port_(std::move(port)), take_(take), thread_([this](const std::stop_token& stop) { run(stop); }) {}

void HidReader::run(const std::stop_token& stop) noexcept {
  HidNews news;
  std::array<std::uint8_t, kReportMax> buffer;
  while (!stop.stop_requested()) {
    const int size = port_->read(buffer, kTimeoutMs);
    if (size > 0) take_(std::span<const std::uint8_t>(buffer).first(static_cast<std::size_t>(size)), news);
    news.gone = size < 0;
    // Stored even when nothing came: whoever listens sees that this thread lives.
    news_.store(news);
    if (news.gone) return;
  }
}

}  // namespace telenano::device

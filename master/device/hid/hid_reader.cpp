#include "master/device/hid/hid_reader.h"

#include <utility>

namespace telenano::device {
namespace {

constexpr int kTimeoutMs = 50;          // for a stop to be heard; reports end the wait at once
constexpr std::size_t kReportMax = 64;  // a full-speed interrupt transfer

}  // namespace

void take_report(std::span<const std::uint8_t> report, HidNews& news) noexcept {
  const std::uint32_t before = news.puck.buttons;
  const PuckReport kind = parse_puck_report(report, news.puck);
  if (kind == PuckReport::kUnknown) {
    ++news.unknown;
    return;
  }
  if (kind != PuckReport::kButtons) ++news.reports;
  const std::uint32_t pressed = news.puck.buttons & ~before;
  for (std::size_t i = 0; i < news.presses.size(); ++i) news.presses[i] += (pressed >> i) & 1u;
}

HidReader::HidReader(std::unique_ptr<HidPort> port)
    : port_(std::move(port)), thread_([this](const std::stop_token& stop) { run(stop); }) {}

void HidReader::run(const std::stop_token& stop) noexcept {
  HidNews news;
  std::array<std::uint8_t, kReportMax> buffer;
  while (!stop.stop_requested()) {
    const int size = port_->read(buffer, kTimeoutMs);
    if (size > 0)
      take_report(std::span<const std::uint8_t>(buffer).first(static_cast<std::size_t>(size)), news);
    news.gone = size < 0;
    // Stored even when nothing came: whoever listens sees that this thread lives.
    news_.store(news);
    if (news.gone) return;
  }
}

}  // namespace telenano::device

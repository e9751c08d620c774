#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <stop_token>
#include <thread>

#include "telenano/common/rt/latest_value.h"
#include "telenano/master/device/hid/hid_port.h"
#include "telenano/master/device/hid/puck_reports.h"

namespace telenano::device {

/// What a HidReader has heard so far.
struct HidNews {
  PuckState puck{};
  std::uint64_t reports = 0;  ///< motion reports understood
  std::uint64_t unknown = 0;  ///< reports that were not
  std::array<std::uint32_t, 32>
      presses{};      ///< of each button: a press between two looks is seen all the same
  bool gone = false;  ///< unplugged, or its node failed; final
};

/// Reads a HID device in a thread of its own and publishes the newest state: the loop never calls a library
/// that may lock or allocate, and a backlog cannot build up, however fast reports come.
class HidReader {
 public:
  /// One report into the news. Pure.
  using Take = void (*)(std::span<const std::uint8_t> report, HidNews& news) noexcept;

  explicit HidReader(std::unique_ptr<HidPort> port, Take take);

  const rt::LatestValue<HidNews>& news() const noexcept { return news_; }

 private:
  void run(const std::stop_token& stop) noexcept;

  std::unique_ptr<HidPort> port_;
  Take take_;
  rt::LatestValue<HidNews> news_;
  std::jthread thread_;
};

void take_puck_report(std::span<const std::uint8_t> report, HidNews& news) noexcept;
void take_pedal_report(std::span<const std::uint8_t> report, HidNews& news) noexcept;

/// True when one of the buttons in `mask` was pressed between two looks, even if it was released again.
bool pressed_since(const HidNews& last, const HidNews& now, std::uint32_t mask) noexcept;

}  // namespace telenano::device

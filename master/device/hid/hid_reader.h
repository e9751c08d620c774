#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <stop_token>
#include <thread>

#include "common/rt/latest_value.h"
#include "master/device/hid/hid_port.h"
#include "master/device/hid/puck_reports.h"

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
  explicit HidReader(std::unique_ptr<HidPort> port);

  const rt::LatestValue<HidNews>& news() const noexcept { return news_; }

 private:
  void run(const std::stop_token& stop) noexcept;

  std::unique_ptr<HidPort> port_;
  rt::LatestValue<HidNews> news_;
  std::jthread thread_;
};

/// One report into the news. Pure.
void take_report(std::span<const std::uint8_t> report, HidNews& news) noexcept;

}  // namespace telenano::device

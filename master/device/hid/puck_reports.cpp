#include "telenano/master/device/hid/puck_reports.h"

#include <cstddef>

namespace telenano::device {
namespace {

constexpr std::size_t kSplitBytes = 7;
constexpr std::size_t kCombinedBytes = 13;
constexpr std::size_t kFewButtonsBytes = 3;
constexpr std::size_t kManyButtonsBytes = 7;

std::int16_t axis_at(std::span<const std::uint8_t> report, std::size_t at) noexcept {
  return static_cast<std::int16_t>(static_cast<std::uint16_t>(report[at] | (report[at + 1] << 8)));
}

void take_axes(std::span<const std::uint8_t> report, std::size_t first, std::size_t count,
               PuckState& state) noexcept {
  for (std::size_t i = 0; i < count; ++i) state.axes[first + i] = axis_at(report, 1 + 2 * i);
}

}  // namespace

PuckReport parse_puck_report(std::span<const std::uint8_t> report, PuckState& state) noexcept {
  if (report.empty()) return PuckReport::kUnknown;
  const std::size_t size = report.size();
  if (report[0] == 1 && size == kSplitBytes) {
    take_axes(report, 0, 3, state);
    return PuckReport::kTranslation;
  }
  if (report[0] == 2 && size == kSplitBytes) {
    take_axes(report, 3, 3, state);
    return PuckReport::kRotation;
  }
  if (report[0] == 1 && size == kCombinedBytes) {
    take_axes(report, 0, 6, state);
    return PuckReport::kMotion;
  }
  if (report[0] == 3 && (size == kFewButtonsBytes || size == kManyButtonsBytes)) {
    state.buttons = 0;
    // The longer form has 48 bits; no product has more than 32 buttons.
    for (std::size_t i = 1; i < size && i <= 4; ++i)
      state.buttons |= std::uint32_t{report[i]} << (8 * (i - 1));
    return PuckReport::kButtons;
  }
  return PuckReport::kUnknown;
}

}  // namespace telenano::device

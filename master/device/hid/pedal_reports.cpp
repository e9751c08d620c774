#include "telenano/master/device/hid/pedal_reports.h"

#include <cstddef>

namespace telenano::device {

std::uint32_t pedal_buttons(std::span<const std::uint8_t> report) noexcept {
  constexpr std::size_t kBootReportBytes = 8;
  constexpr std::uint8_t kLetterA = 4;
  std::uint32_t mask = 0;
  if (report.size() == kBootReportBytes) {
    for (const std::uint8_t code : report.subspan(2)) {
      if (code >= kLetterA && code < kLetterA + 32) mask |= 1u << (code - kLetterA);
    }
    return mask;
  }
  for (std::size_t n = 0; n < report.size() && n < 4; ++n) mask |= std::uint32_t{report[n]} << (8 * n);
  return mask;
}

}  // namespace telenano::device

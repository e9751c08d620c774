#include "telenano/common/base/utc_time.h"

#include <array>
#include <chrono>
#include <cstdio>

namespace telenano {
namespace {

using std::chrono::day;
using std::chrono::floor;
using std::chrono::month;
using std::chrono::seconds;
using std::chrono::sys_days;
using std::chrono::sys_seconds;
using std::chrono::year;
using std::chrono::year_month_day;

constexpr std::string_view kForm = "dddd-dd-ddTdd:dd:ddZ";  // d: a digit

// The number of the digits from `begin` on.
int number(std::string_view text, std::size_t begin, std::size_t digits) noexcept {
  int value = 0;
  for (const char c : text.substr(begin, digits)) value = 10 * value + (c - '0');
  return value;
}

}  // namespace

std::string utc_text(std::int64_t unix_s) {
  const sys_seconds at{seconds{unix_s}};
  const sys_days date = floor<std::chrono::days>(at);
  const year_month_day calendar{date};
  const auto in_day = static_cast<unsigned>((at - date).count());
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), "%04d-%02u-%02uT%02u:%02u:%02uZ", static_cast<int>(calendar.year()),
                static_cast<unsigned>(calendar.month()), static_cast<unsigned>(calendar.day()), in_day / 3600,
                in_day / 60 % 60, in_day % 60);
  return text.data();
}

std::optional<std::int64_t> parse_utc(std::string_view text) noexcept {
  if (text.size() != kForm.size()) return std::nullopt;
  for (std::size_t i = 0; i < kForm.size(); ++i) {
    const bool digit = text[i] >= '0' && text[i] <= '9';
    if (kForm[i] == 'd' ? !digit : text[i] != kForm[i]) return std::nullopt;
  }
  const year_month_day date{year{number(text, 0, 4)}, month{static_cast<unsigned>(number(text, 5, 2))},
                            day{static_cast<unsigned>(number(text, 8, 2))}};
  const int hour = number(text, 11, 2), minute = number(text, 14, 2), second = number(text, 17, 2);
  if (!date.ok() || hour > 23 || minute > 59 || second > 59) return std::nullopt;
  const std::int64_t unix_s =
      std::int64_t{86400} * sys_days{date}.time_since_epoch().count() + 3600 * hour + 60 * minute + second;
  if (unix_s < 0) return std::nullopt;
  return unix_s;
}

}  // namespace telenano

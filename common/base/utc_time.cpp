#include "telenano/common/base/utc_time.h"

namespace telenano {
namespace {

constexpr std::string_view kForm = "dddd-dd-ddTdd:dd:ddZ";  // d: a digit
constexpr std::int64_t kDay_s = 86400;

// The number of the digits from `begin` on.
std::int64_t number(std::string_view text, std::size_t begin, std::size_t digits) noexcept {
  std::int64_t value = 0;
  for (const char c : text.substr(begin, digits)) value = 10 * value + (c - '0');
  return value;
}

std::string digits(std::int64_t value, std::size_t count) {
  std::string text(count, '0');
  for (std::size_t i = count; i-- > 0; value /= 10) text[i] = static_cast<char>('0' + value % 10);
  return text;
}

constexpr bool is_leap(std::int64_t year) noexcept {
  return year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
}

constexpr std::int64_t month_days(std::int64_t year, std::int64_t month) noexcept {
  return month == 2 ? (is_leap(year) ? 29 : 28)
                    : (month == 4 || month == 6 || month == 9 || month == 11 ? 30 : 31);
}

// Days from 1970-01-01 to the first of a year: 365 each, and one for each leap year before it.
constexpr std::int64_t days_to_year(std::int64_t year) noexcept {
  const auto leap_years = [](std::int64_t before) {
    const std::int64_t y = before - 1;
    return y / 4 - y / 100 + y / 400;
  };
  return 365 * (year - 1970) + leap_years(year) - leap_years(1970);
}

}  // namespace

std::string utc_text(std::int64_t unix_s) {
  const std::int64_t day = unix_s / kDay_s, in_day_s = unix_s % kDay_s;
  std::int64_t year = 1970 + day / 366;  // never too late; the right one is at most 23 years on up to 9999
  while (days_to_year(year + 1) <= day) ++year;
  std::int64_t left = day - days_to_year(year), month = 1;
  for (; left >= month_days(year, month); ++month) left -= month_days(year, month);
  return digits(year, 4) + "-" + digits(month, 2) + "-" + digits(left + 1, 2) + "T" +
         digits(in_day_s / 3600, 2) + ":" + digits(in_day_s / 60 % 60, 2) + ":" + digits(in_day_s % 60, 2) +
         "Z";
}

std::optional<std::int64_t> parse_utc(std::string_view text) noexcept {
  if (text.size() != kForm.size()) return std::nullopt;
  for (std::size_t i = 0; i < kForm.size(); ++i) {
    const bool digit = text[i] >= '0' && text[i] <= '9';
    if (kForm[i] == 'd' ? !digit : text[i] != kForm[i]) return std::nullopt;
  }
  const std::int64_t year = number(text, 0, 4), month = number(text, 5, 2), day = number(text, 8, 2);
  const std::int64_t hour = number(text, 11, 2), minute = number(text, 14, 2), second = number(text, 17, 2);
  if (year < 1970 || month < 1 || month > 12 || day < 1 || day > month_days(year, month)) return std::nullopt;
  if (hour > 23 || minute > 59 || second > 59) return std::nullopt;
  std::int64_t days = days_to_year(year) + day - 1;
  for (std::int64_t m = 1; m < month; ++m) days += month_days(year, m);
  return kDay_s * days + 3600 * hour + 60 * minute + second;
}

}  // namespace telenano

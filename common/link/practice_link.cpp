#include "telenano/common/link/practice_link.h"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "telenano/common/base/error.h"

namespace telenano::link {
namespace {

[[noreturn]] void refuse(const std::string& flag, const std::string& text) {
  throw UserError(
      flag + " " + text +
      ": expected off, or some of rtt=0 to 2000 (ms), jitter=0 to 500 (ms), loss=0 to 50 (percent), "
      "with commas between");
}

// 12.34 → "12.3", 12.04 → "12".
std::string tenths(double value) {
  const long long n = std::llround(10 * value);
  return std::to_string(n / 10) + (n % 10 == 0 ? "" : "." + std::to_string(n % 10));
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
  const auto add = [&](double value, const std::string& part) {
    if (value > 0) text += (text.empty() ? "" : ", ") + part;
  };
  add(link.rtt_ms, "+" + std::to_string(std::llround(link.rtt_ms)) + " ms");
  add(link.jitter_ms, "jitter " + std::to_string(std::llround(link.jitter_ms)) + " ms");
  add(link.loss, tenths(100 * link.loss) + " % lost");
  return text;
}

}  // namespace telenano::link

#pragma once

#include <string>

namespace telenano::link {

/// A worse link than there is, to practise on: what is added to the link, in both directions alike.
struct PracticeLink {
  double rtt_ms = 0;     ///< added to the round trip, 0 to 2000
  double jitter_ms = 0;  ///< of each way besides: half-normal, in order; 0 to 500
  double loss = 0;       ///< of each way, independent; 0 to 0.5
  bool any() const noexcept { return rtt_ms > 0 || jitter_ms > 0 || loss > 0; }
};

inline constexpr double kPracticeRttMost_ms = 2000;
inline constexpr double kPracticeJitterMost_ms = 500;
inline constexpr double kPracticeLossMost = 0.5;

/// "rtt=100,jitter=5,loss=2" (ms, ms, percent), each optional; "0" or "off": nothing is added yet. Throws
/// UserError naming `flag`.
PracticeLink parse_practice_link(const std::string& text, const std::string& flag);
/// "+100 ms, jitter 5 ms, 2.5 % lost": for a person, to a whole millisecond and a tenth of a percent; empty
/// when nothing is added.
std::string practice_text(const PracticeLink& link);

}  // namespace telenano::link

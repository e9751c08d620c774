// Every combination of what the words depend on, against rules and not against the words of another table.
#include "telenano/master/view_model/session_banner.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <initializer_list>
#include <set>
#include <string>
#include <utility>

#include "telenano/master/station/station.h"

namespace telenano::view_model {
namespace {

using station::Mode;

struct Case {
  Mode mode = Mode::kEngaged;
  Origin origin = Origin::kComputed;
  double silence_s = 0;
  double give_up_s = 0;
  bool ended = false;
  bool played = false;
  bool observes = false;
  bool ramp = false;
  bool clutch = false;
  bool deadman = false;
  std::uint32_t fault = 0;
  station::TwinState twin = station::TwinState::kNone;
  control::Method method = control::Method::kTwin;

  recording::Sample sample() const {
    recording::Sample s;
    s.time_s = 100;
    s.reply_age_ms = 1e3 * silence_s;
    s.station_mode = static_cast<std::uint32_t>(mode);
    s.station_faults = fault;
    s.method = static_cast<std::uint32_t>(method);
    s.limit_flags = (observes ? recording::kLimitObserves : 0u) | (ramp ? recording::kLimitRamp : 0u);
    s.buttons = (clutch ? device::kButtonClutch : 0u) | (deadman ? device::kButtonDeadman : 0u);
    return s;
  }
};

bool starts(const std::string& word, const std::string& with) {
  return word.rfind(with, 0) == 0;
}

// Empty: the banner keeps every rule.
std::string broken_rule(const Case& c, const SessionBanner& banner) {
  const auto count = [&](const char* with) {
    return std::count_if(banner.badges.begin(), banner.badges.end(),
                         [&](const Badge& b) { return starts(b.word, with); });
  };
  const auto filled = [&](const char* with) {
    return std::any_of(banner.badges.begin(), banner.badges.end(),
                       [&](const Badge& b) { return starts(b.word, with) && b.filled; });
  };
  const auto line = [&](const char* with) {
    return std::any_of(banner.lines.begin(), banner.lines.end(),
                       [&](const Message& m) { return m.text.find(with) != std::string::npos; });
  };
  const bool silent = c.silence_s > 0;
  std::set<std::string> words;
  for (const Badge& b : banner.badges) {
    if (b.word.empty() || !words.insert(b.word).second) return "a word is empty or there twice";
  }
  if (count("SIM") != (c.origin == Origin::kComputed)) return "SIM";
  if (count("AFM") != (c.origin == Origin::kMeasured)) return "AFM";
  if (count("NO SAMPLE YET") != (c.origin == Origin::kUnknown)) return "no sample";
  if ((silent || c.ended || c.played) && (filled("SIM") || filled("AFM"))) return "looks as if it were now";
  if (!silent && !c.ended && !c.played && c.origin != Origin::kUnknown && !filled("SIM") && !filled("AFM"))
    return "a session that goes on does not look so";
  if (count("RECORDING") != c.played) return "recording";
  if (count("Ended") != c.ended) return "end";
  if (c.ended)
    return banner.badges.size() == (c.played ? 3u : 2u) && banner.lines.empty() ? "" : "words after the end";

  const auto link = count("STALE") + count("LOST") + count("NO ANSWER");
  if (link != silent) return "silence";
  if (silent) {
    const char* const word = c.origin == Origin::kUnknown ? "NO ANSWER"
                             : c.mode == Mode::kHeld      ? "LOST"
                                                          : "STALE";
    if (!filled(word)) return "the word of the silence";
    if (!line("No answer from the server for")) return "silence without a line";
    if (count("Engaged") + count("Engaging") + count("Ready") + count("Clutch") != 0)
      return "at work, though silent";
    if (line("goes on by itself") != (c.mode == Mode::kHeld && !c.played)) return "lost, and what to do?";
    const auto left = std::any_of(banner.badges.begin(), banner.badges.end(),
                                  [](const Badge& b) { return b.word.find(" s left") != std::string::npos; });
    if (left != (c.give_up_s > 0 && !c.played)) return "countdown";
  }
  if ((count("Observing") != 0) != c.observes) {
    // A mode's words may not hide it, nor say it of a hand that leads.
    return "observing";
  }
  if (c.observes && !line("Observing:")) return "observing without a line";
  if (c.observes && count("Engaged") + count("Engaging") + count("Ready") != 0) return "an observer at work";
  if (filled("Stopped") != (c.mode == Mode::kStopped)) return "stopped";
  using station::TwinState;
  const bool given_up = c.twin == TwinState::kGivenUp;
  const bool felt = c.method == control::Method::kTwin && c.twin != TwinState::kNone && !given_up;
  if (count("Twin") != ((felt || given_up) && !c.played && !c.observes)) return "twin";
  if (count("Twin") != 0) {
    const bool apart = c.twin == TwinState::kApart, waits = c.twin == TwinState::kWaits;
    if (filled("Twin confirmed") != (felt && !apart && !waits && !silent)) return "confirmed by what?";
    if (filled("Twin apart") != apart || filled("Twin given up")) return "apart";
    if (line("server's state is taken up") != apart) return "apart without a line";
    if (filled("Twin waits") != waits || line("state is on the way") != waits) return "waits";
    if (line("another method from now on") != given_up) return "given up without a line";
  }
  if (c.mode == Mode::kStopped && banner.lines.empty()) return "stopped without a cause";
  if (c.mode == Mode::kStopped && !line("lear") && !line("anew") && !line("report"))
    return "stopped, and what to do?";
  if (c.mode == Mode::kEngaged && !silent && !c.observes && count("Engag") != 1) return "engaged";
  return "";
}

std::vector<std::uint32_t> latched_faults() {
  return {0,
          station::kFaultStopPressed,
          station::kFaultVelocityTrip,
          station::kFaultHandPosNonFinite,
          station::kFaultAppliedNonFinite,
          station::kFaultDeviceFailed,
          station::kFaultForceNonFinite,
          station::kFaultSlaveStiffer,
          station::kFaultOtherScene,
          station::kFaultStale,
          station::kFaultOld,
          station::kFaultTwinLeft};
}

constexpr std::array<std::pair<station::TwinState, control::Method>, 8> kTwins = {{
    {station::TwinState::kWaits, control::Method::kTwin},
    {station::TwinState::kNone, control::Method::kTwin},
    {station::TwinState::kBehind, control::Method::kTwin},
    {station::TwinState::kConfirmed, control::Method::kTwin},
    {station::TwinState::kApart, control::Method::kTwin},
    {station::TwinState::kGivenUp, control::Method::kModel},
    {station::TwinState::kConfirmed, control::Method::kTank},
    {station::TwinState::kApart, control::Method::kTank},
}};

TEST(SessionBanner, NeverMisleadsInAnyCombination) {
  int cases = 0;
  int broken = 0;
  for (const Mode mode :
       {Mode::kIdle, Mode::kReady, Mode::kEngaged, Mode::kHeld, Mode::kStopped, Mode::kHoming})
    for (const Origin origin : {Origin::kUnknown, Origin::kComputed, Origin::kMeasured})
      for (const double silence_s : {0.0, 0.3, 5.0, 12.0})
        for (const double give_up_s : {0.0, 10.0})
          for (const std::uint32_t fault : latched_faults())
            for (unsigned bits = 0; bits < 64 * kTwins.size(); ++bits) {
              const auto bit = [&](unsigned i) { return (bits >> i & 1u) != 0; };
              const auto& [twin, method] = kTwins[bits / 64];
              const Case c{mode,   origin, silence_s, give_up_s, bit(0), bit(1), bit(2),
                           bit(3), bit(4), bit(5),    fault,     twin,   method};
              const recording::Sample now = c.sample();
              const std::string rule =
                  broken_rule(c, session_banner({now, origin, give_up_s, c.ended, c.played, twin}));
              ++cases;
              if (rule.empty() || ++broken > 5) continue;
              ADD_FAILURE() << rule << ": mode " << static_cast<int>(mode) << ", origin "
                            << static_cast<int>(origin) << ", silent for " << silence_s << " s of "
                            << give_up_s << ", fault " << fault << ", bits " << bits;
            }
  EXPECT_EQ(broken, 0) << "of " << cases;
  EXPECT_EQ(cases, 6 * 3 * 4 * 2 * 12 * 64 * 8);
}

TEST(SessionBanner, CountsDownToTheEndAndNotBelow) {
  Case c;
  const auto word = [&](double silence_s) {
    c.silence_s = silence_s;
    const recording::Sample now = c.sample();
    return session_banner({now, Origin::kMeasured, 10}).badges.at(1).word;
  };
  EXPECT_EQ(word(3.2), "STALE 3.2 s, 7 s left");
  EXPECT_EQ(word(11), "STALE 11.0 s, 0 s left");
  c.mode = Mode::kHeld;
  EXPECT_EQ(word(9.5), "LOST 9.5 s, 1 s left");
}

}  // namespace
}  // namespace telenano::view_model

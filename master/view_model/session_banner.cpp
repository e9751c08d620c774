#include "telenano/master/view_model/session_banner.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "telenano/master/station/station.h"

namespace telenano::view_model {
namespace {

Badge source_badge(Origin origin, bool current) {
  switch (origin) {
    case Origin::kComputed:
      return {Badge::Kind::kSource, "SIM", Mood::kCalm, current};
    case Origin::kMeasured:
      return {Badge::Kind::kSource, "AFM", Mood::kAlarm, current};
    case Origin::kUnknown:
      break;
  }
  return {Badge::Kind::kSource, "NO SAMPLE YET", Mood::kCalm, false};
}

Badge silence_badge(const SessionInputs& inputs, double silence_s) {
  const bool held = static_cast<station::Mode>(inputs.now.station_mode) == station::Mode::kHeld;
  const char* const word = inputs.origin == Origin::kUnknown ? "NO ANSWER" : held ? "LOST" : "STALE";
  std::string text = fmt::format("{} {:.1f} s", word, silence_s);
  if (inputs.give_up_s > 0 && !inputs.played)
    text += fmt::format(", {:.0f} s left", std::ceil(std::max(inputs.give_up_s - silence_s, 0.0)));
  return {Badge::Kind::kLink, std::move(text), Mood::kAlarm, true};
}

/// None: there is nothing to tell.
std::optional<Badge> twin_badge(const SessionInputs& inputs, bool current) {
  using station::TwinState;
  const bool felt = static_cast<control::Method>(inputs.now.method) == control::Method::kTwin;
  if (inputs.played || observes(inputs.now)) return std::nullopt;
  if (inputs.twin == TwinState::kGivenUp)
    return Badge{Badge::Kind::kTwin, "Twin given up", Mood::kWarning, false};
  if (inputs.twin == TwinState::kNone || !felt) return std::nullopt;
  if (inputs.twin == TwinState::kWaits) return Badge{Badge::Kind::kTwin, "Twin waits", Mood::kWarning, true};
  if (inputs.twin == TwinState::kApart) return Badge{Badge::Kind::kTwin, "Twin apart", Mood::kWarning, true};
  if (!current) return Badge{Badge::Kind::kTwin, "Twin unconfirmed", Mood::kWarning, false};
  return Badge{Badge::Kind::kTwin, "Twin confirmed", Mood::kGood, true};
}

void tell_twin(const Badge& badge, const SessionInputs& inputs, std::vector<Message>& lines) {
  if (inputs.twin == station::TwinState::kWaits)
    lines.push_back({"The tip is yours: its state is on the way", Mood::kWarning});
  if (inputs.twin == station::TwinState::kApart)
    lines.push_back(
        {"The sample here and the server's differ: the server's state is taken up, gently", Mood::kWarning});
  if (inputs.twin == station::TwinState::kGivenUp)
    lines.push_back(
        {"The server's sample differs from its scene here, or is not confirmed: another method from now on",
         badge.mood});
}

}  // namespace

SessionBanner session_banner(const SessionInputs& inputs) {
  SessionBanner banner;
  const recording::Sample& now = inputs.now;
  const auto mode = static_cast<station::Mode>(now.station_mode);
  const double silence_s = silent_s(now);
  const bool current = silence_s == 0 && !inputs.ended && !inputs.played;
  auto& badges = banner.badges;
  if (inputs.played) badges.push_back({Badge::Kind::kPlayed, "RECORDING", Mood::kWarning, true});
  badges.push_back(source_badge(inputs.origin, current));
  if (inputs.ended) {
    badges.push_back({Badge::Kind::kEnd, "Ended", Mood::kAlarm, true});
    return banner;
  }
  if (silence_s > 0) badges.push_back(silence_badge(inputs, silence_s));
  const Message word = mode_text(now);
  const bool of_the_hand =
      word.mood == Mood::kAlarm || mode == station::Mode::kIdle || mode == station::Mode::kHoming;
  if (silence_s == 0 || of_the_hand)
    badges.push_back({Badge::Kind::kMode, word.text, word.mood, word.mood != Mood::kCalm});
  const bool told = badges.back().word == "Observing";
  if (observes(now) && !told) badges.push_back({Badge::Kind::kMode, "Observing", Mood::kWarning, true});

  const std::optional<Badge> twin = twin_badge(inputs, current);
  if (twin) badges.push_back(*twin);

  banner.lines = force_text(now, inputs.device_cause, inputs.mouse_leads);
  if (twin) tell_twin(*twin, inputs, banner.lines);
  const bool alarm = std::any_of(banner.lines.begin(), banner.lines.end(),
                                 [](const Message& line) { return line.mood == Mood::kAlarm; });
  if (mode == station::Mode::kStopped && !alarm)
    banner.lines.insert(banner.lines.begin(),
                        {"Stopped: zero force. Look at it, then clear (R)", Mood::kAlarm});
  if (silence_s > 0 && mode == station::Mode::kHeld && !inputs.played)
    banner.lines.insert(
        banner.lines.begin(),
        {"It goes on by itself once the server answers: look at the network and at the server",
         Mood::kWarning});
  if (silence_s > 0)
    banner.lines.insert(banner.lines.begin(),
                        {silence_text(silence_s, inputs.played ? 0 : inputs.give_up_s), Mood::kAlarm});
  return banner;
}

}  // namespace telenano::view_model

#include "telenano/master/app/failure_text.h"

#include <fmt/format.h>

#include "telenano/master/app/run/session_terms.h"
#include "telenano/master/connection/connect.h"

namespace telenano::app {
namespace {

std::string device_trouble(const RealTimeSession& live) {
  const device::ForceOffCause cause = live.progress().force_off;
  return cause == device::ForceOffCause::kNone ? "" : fmt::format(": {}", device::force_off_text(cause));
}

}  // namespace

std::string failure_text(const RealTimeSession& live, const station::Station& station,
                         const link::ClientSession& session, const RunOptions& options,
                         const connection::ServerLink& way, double rate_hz) {
  const std::string& server = options.server;
  const auto tip_stayed_up = [&](const std::string& what) {
    return fmt::format(
        "{}: the server at {} kept the tip withdrawn all the time, so the force was zero; its log says why",
        what, server);
  };
  switch (live.ending()) {
    case Ending::kTaskDone:
      return live.tip_stayed_up() ? tip_stayed_up("nothing was done") : "";
    case Ending::kStopped:
      return live.tip_stayed_up() ? tip_stayed_up("stopped by the operator") : "";
    case Ending::kTipUp:
      return tip_stayed_up(fmt::format("given up after {:g} s", options.give_up_s));
    case Ending::kNotEngaged: {
      const std::string far = too_far_text(station.config(), station.method(),
                                           1e-6 * live.progress().link.rtt_us, session.welcome());
      return fmt::format("the hand was not engaged for as long as its task lasts{}{}; the force is zero",
                         far.empty() ? "" : ": ", far);
    }
    case Ending::kOtherScene:
      return "";
    case Ending::kFault:
      return fmt::format("the station stopped itself: {}{}; the force is zero",
                         station::fault_name(station.latched_faults()), device_trouble(live));
    case Ending::kServerEnded:
      return fmt::format("the server at {} has ended the session; the force is zero", server);
    case Ending::kRefused:
      return connection::refusal_text(session.refuse(), rate_hz, server);
    case Ending::kServerGone:
      if (live.progress().shutting_down) {
        return fmt::format(
            "the server at {} shut down and did not come back within {:g} s; the force is zero", server,
            options.give_up_s);
      }
      return fmt::format("the server at {} has been silent for {:g} s; the force is zero{}", server,
                         options.give_up_s, way.failure());
  }
  return "";
}

}  // namespace telenano::app

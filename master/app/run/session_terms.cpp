#include "telenano/master/app/run/session_terms.h"

#include <fmt/format.h>

#include <cstdio>

#include "telenano/common/base/error.h"
#include "telenano/common/config/print.h"
#include "telenano/common/control/method.h"
#include "telenano/master/app/plan/station_plan.h"
#include "telenano/master/app/run/session_twin.h"

namespace telenano::app {

double playout_delay_s(const StationFile& file) {
  const link::PlayoutConfig& playout = file.link.playout;
  return playout.mode == link::PlayoutConfig::Mode::kNewest ? 0
                                                            : 1e-9 * static_cast<double>(playout.delay_ns);
}

std::string too_far_text(const station::StationConfig& config, control::Method method, double rtt_s,
                         const link::Welcome& welcome) {
  const bool twin = method == control::Method::kTwin;
  const double most_s = twin ? kTwinMostS : config.age_most_s(method);
  if (!(rtt_s > most_s)) return "";
  return fmt::format("the round trip is {:.0f} ms, and method {} shows forces up to {:.0f} ms; {}",
                     1e3 * rtt_s, control::method_name(method), 1e3 * most_s,
                     twin ? "only a shorter way helps"
                     : welcome.scene.empty()
                         ? "this server shares no scene for --method twin: only a shorter way helps"
                         : "give --method twin");
}

void tell_terms(const StationFile& file, const link::Welcome& welcome, const LinkDelay& link,
                const std::string& scene_name, const station::ScalingCheck& check, const std::string& planned,
                const device::DeviceInfo& device, bool records) {
  const control::Method method = file.station.method;
  config::print(stderr, "session {:016x} on scene '{}', method {}{}, {}\n", welcome.session_id, scene_name,
                control::method_name(method),
                !file.chooses_method               ? ""
                : method == control::Method::kTwin ? " (the server's scene runs here too)"
                : link.measures                    ? " (this slave measures its forces)"
                                                   : " (by the round trip)",
                check.text);
  const control::Method used = station::usable_method(method, welcome.feature_bits);
  if (used != method) {
    config::print(stderr, "note: this server does not offer what method {} needs; running {}\n",
                  control::method_name(method), control::method_name(used));
  }
  if (const std::string far = too_far_text(file.station, used, link.median_s, welcome); !far.empty())
    config::print(stderr, "note: the hand will not engage: {}\n", far);
  if (!planned.empty()) config::print(stderr, "scaling {}\n", planned);
  if (device.has_force) config::print(stderr, "{}\n", damping_text(file, device));
  if (file.redundancy > 0 && (welcome.feature_bits & link::kFeatureRedundancy) == 0)
    config::print(stderr, "note: this server does not take repeated commands; running without redundancy\n");
  if (const double permille = file.kept_reply_deadband_permille.value_or(0); permille > 0) {
    if ((welcome.feature_bits & link::kFeatureStepLog) != 0) {
      config::print(stderr,
                    "note: a session whose steps are logged has every command answered; running without "
                    "--reply-deadband\n");
    } else if ((welcome.feature_bits & link::kFeatureReplyDeadband) == 0) {
      config::print(stderr, "note: this server leaves no reply out; running without --reply-deadband\n");
    } else if (records) {
      config::print(stderr,
                    "note: with --reply-deadband the forces in the recording have steps of up to {:g} %\n",
                    0.1 * permille);
    }
  }
  const double playout_s = playout_delay_s(file);
  if (file.link.playout.mode == link::PlayoutConfig::Mode::kConstant && playout_s < link.p99_s) {
    config::print(
        stderr,
        "note: playout_delay_ms {:g} is less than the link's round trip (p99 {:.1f} ms): replies that "
        "come later are not felt\n",
        playout_s * 1e3, link.p99_s * 1e3);
  }
  if (!check.note.empty()) config::print(stderr, "note: {}\n", check.note);
  const control::CompandingConfig& companding = file.station.companding;
  if (companding.on() && method == control::Method::kTwin) {
    config::print(
        stderr,
        "companding: attraction before contact is up to {:g} times as strong, in tasks {}; the hand "
        "may get {:.3g} mJ more energy by it\n",
        companding.gain, file.companding_tasks,
        1e3 * file.station.scaling.hand_energy_j(companding.most_aj()));
  } else if (companding.on()) {
    config::print(stderr, "note: companding works only with method twin: forces are shown unchanged\n");
  }
}

std::uint32_t tip_wish(const RunOptions& options, const std::string& server, bool shared) {
  if (!shared && options.observe) {
    throw RunError(fmt::format(
        "--observe: the server at {} gives each session its own tip, so there is no shared tip to "
        "observe; start the server with --share one-tip",
        server));
  }
  if (!shared && options.take_over && !options.quiet)
    config::print(stderr, "note: --take-over: this server gives each session a tip of its own\n");
  if (shared && !options.quiet) {
    config::print(stderr, "note: this server's tip is shared: {}\n",
                  options.observe
                      ? options.duration_s ? "observing it" : "observing it, until you stop this with Ctrl-C"
                  : options.take_over ? "asking for it"
                                      : "taking it if it is free, else observing (--take-over asks for it)");
  }
  if (options.observe) return link::kFlagHandOver;
  return options.take_over ? std::uint32_t{link::kFlagTakeOver} : 0u;
}

}  // namespace telenano::app

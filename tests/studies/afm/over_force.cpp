#include "tests/studies/afm/over_force.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "telenano/common/base/det_math.h"
#include "telenano/nve_server/afm_sim/default_scene.h"
#include "tests/support/virtual_afm_slave.h"

namespace telenano::studies {
namespace {

using support::VirtualAfm;

constexpr std::int64_t kMs = 1'000'000;
constexpr double kSpeedNmS = 15, kFromNm = 10, kToNm = -12, kHoldS = 0.5;
constexpr double kDownS = (kFromNm - kToNm) / kSpeedNmS;
constexpr double kIndentS = 2 * kDownS + kHoldS;
constexpr double kAfterS = 0.8;  // watched after the fault is over

double depth_at(double t_s) {
  if (t_s < kDownS) return kFromNm - kSpeedNmS * t_s;
  if (t_s < kDownS + kHoldS) return kToNm;
  return std::min(kFromNm, kToNm + kSpeedNmS * (t_s - kDownS - kHoldS));
}

/// Runs the indent; keeps copies of the rig on the way, to begin from.
struct Indent {
  static constexpr double kEveryS = 0.1;
  std::vector<VirtualAfm> kept;
  std::int64_t begin_ns;

  explicit Indent(const VirtualAfm& ready) {
    VirtualAfm afm = ready;
    begin_ns = afm.now_ns() + 200 * kMs;
    afm::PortTarget wish;
    wish.session = 1;
    wish.follow = true;
    go(afm, wish, begin_ns);
    for (double at_s = 0; at_s < kIndentS; at_s += kEveryS) {
      go(afm, wish, begin_ns + static_cast<std::int64_t>(at_s * 1e9));
      kept.push_back(afm);
    }
  }
  double time_s(const VirtualAfm& afm) const { return 1e-9 * static_cast<double>(afm.now_ns() - begin_ns); }
  void go(VirtualAfm& afm, afm::PortTarget& wish, std::int64_t until_ns, bool told = true) const {
    while (afm.now_ns() < until_ns) {
      if (told) {
        wish.time_ns = afm.now_ns();
        wish.target_w_nm = Vec3(0, 0, depth_at(std::max(0.0, time_s(afm))));
      }
      afm.advance_to(std::min(afm.now_ns() + kMs, until_ns), wish);
    }
  }
};

void run_trial(const Indent& indent, FaultTrial& t, double drift_nm_s, std::uint64_t seed) {
  Random random(seed);
  VirtualAfm afm = indent.kept[static_cast<std::size_t>(t.at_s / Indent::kEveryS)];
  afm::PortTarget wish;
  wish.session = 1;
  wish.follow = true;
  indent.go(afm, wish, indent.begin_ns + static_cast<std::int64_t>(t.at_s * 1e9));
  const auto& config = afm.logic().config();
  afm.controller().tip().forget_peak();
  const std::uint64_t safe_tips = afm.controller().safe_tips();
  const std::int64_t length_ns = static_cast<std::int64_t>(t.length_s * 1e9);
  const bool told = t.fault != AfmFault::kLinkCut;
  const std::int64_t fault_ns = afm.now_ns();
  bool lasts = false;
  switch (t.fault) {
    case AfmFault::kLinkCut:
      break;
    case AfmFault::kServerKilled:
      afm.kill_server();
      break;
    case AfmFault::kSilent:
      lasts = true;
      afm.apply({0, afm_sim::FaultKind::kSilent, length_ns, 0});
      break;
    case AfmFault::kReset:
      afm.apply({0, afm_sim::FaultKind::kReset, 0, 0});
      break;
    case AfmFault::kGarbage:
      afm.apply({0, afm_sim::FaultKind::kGarbage, 0, 0});
      break;
    case AfmFault::kSlow:
      afm.apply(
          {0, afm_sim::FaultKind::kSlow, length_ns, static_cast<std::int64_t>(1e6 * random.uniform(1, 100))});
      break;
    case AfmFault::kControllerCut:
      lasts = true;
      afm.cut(length_ns);
      break;
  }
  const std::int64_t reachable_ns = fault_ns + (lasts ? length_ns : 0);
  const bool passing = t.fault == AfmFault::kSilent || t.fault == AfmFault::kSlow;
  t.must_withdraw = !passing || (t.fault == AfmFault::kSilent && t.length_s > 0.15);
  const std::int64_t end_ns = reachable_ns + static_cast<std::int64_t>(kAfterS * 1e9);
  bool up = false;
  while (afm.now_ns() < end_ns) {
    indent.go(afm, wish, afm.now_ns() + kMs, told);
    const bool now_up = afm.controller().withdrawn();
    if (now_up && !up) t.withdrawn_after_s = 1e-9 * static_cast<double>(afm.now_ns() - reachable_ns);
    if (!now_up) t.withdrawn_after_s = -1;
    up = now_up;
  }
  if (t.withdrawn_after_s >= 0 || up) t.withdrawn_after_s = std::max(t.withdrawn_after_s, 0.0);
  t.safe_tip = afm.controller().safe_tips() > safe_tips;
  t.peak_nn = afm.controller().tip().peak_force_nn();
  t.over_nn = std::max(0.0, t.peak_nn - config.force_max_nn);
  const double outage_s = 1e-9 * static_cast<double>(reachable_ns - fault_ns) + 0.2;
  t.allowed_nn = (config.step_nm + std::fabs(drift_nm_s) * outage_s) * config.spring_constant_n_m;
}

}  // namespace

const char* fault_name(AfmFault fault) noexcept {
  constexpr const char* kNames[] = {"link cut",      "server killed", "controller silent", "TCP reset",
                                    "garbage reply", "slow replies",  "controller cut off"};
  return kNames[static_cast<std::size_t>(fault)];
}

std::vector<FaultTrial> run_fault_trials(const afm::AfmConfig& config, const afm_sim::SimConfig& rig,
                                         int trials, std::uint64_t seed) {
  const Indent indent(support::approached(config, rig, afm_sim::default_scene(), seed));
  Random random(seed);
  std::vector<FaultTrial> all(static_cast<std::size_t>(trials));
  for (FaultTrial& t : all) {
    t.fault = static_cast<AfmFault>(random.below(kAfmFaults));
    t.at_s = random.uniform(0, kIndentS - Indent::kEveryS);
    t.length_s = 1e-3 * det_exp(random.uniform(0, det_log(1e4)));
    run_trial(indent, t, rig.drift_z_nm_s, random.bits());
  }
  return all;
}

std::string fault_csv(const std::vector<FaultTrial>& trials) {
  std::string csv =
      "fault,at_s,length_s,peak_nn,over_nn,allowed_nn,must_withdraw,withdrawn_after_s,safe_tip\n";
  for (const FaultTrial& t : trials) {
    csv += fmt::format("{},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:d},{:.6g},{:d}\n", fault_name(t.fault),
                       t.at_s, t.length_s, t.peak_nn, t.over_nn, t.allowed_nn, t.must_withdraw,
                       t.withdrawn_after_s, t.safe_tip);
  }
  return csv;
}

std::string fault_section(const std::vector<FaultTrial>& trials, const afm::AfmConfig& config) {
  std::string html = fmt::format(
      "<h2>Over-force under faults</h2>\n<p>{} indents that the force limit of {:g} nN ends, each with one "
      "fault "
      "at a random moment; silences and cuts of 1 ms to 10 s. Allowed beyond the limit: (one step of {:g} nm "
      "+ "
      "drift · outage) · {:g} N/m. Withdrawn after: since the controller could be reached again, to the "
      "upper "
      "end of its range.</p>\n",
      trials.size(), config.force_max_nn, config.step_nm, config.spring_constant_n_m);
  html +=
      "<div class=\"scroll\"><table>\n<thead><tr><th>fault</th><th>trials</th><th>greatest over-force, "
      "nN</th>"
      "<th>part of what is allowed, at most</th><th>withdrawn after, ms, at most</th><th>not withdrawn "
      "though due</th>"
      "<th>SafeTip acted</th></tr></thead>\n<tbody>\n";
  for (int f = 0; f < kAfmFaults; ++f) {
    int n = 0, missing = 0, safe = 0;
    double over = 0, part = 0, after = 0;
    for (const FaultTrial& t : trials) {
      if (t.fault != static_cast<AfmFault>(f)) continue;
      ++n;
      over = std::max(over, t.over_nn);
      part = std::max(part, t.over_nn / t.allowed_nn);
      after = std::max(after, t.withdrawn_after_s);
      if (t.must_withdraw && t.withdrawn_after_s < 0) ++missing;
      if (t.safe_tip) ++safe;
    }
    html += fmt::format(
        "<tr><th>{}</th><td>{}</td><td>{:.1f}</td><td>{:.0f} "
        "%</td><td>{:.0f}</td><td>{}</td><td>{}</td></tr>\n",
        fault_name(static_cast<AfmFault>(f)), n, over, 100 * part, 1e3 * after, missing, safe);
  }
  return html + "</tbody></table></div>\n";
}

}  // namespace telenano::studies

#include "tests/studies/methods/attack_section.h"

#include <fmt/format.h>

#include <algorithm>

#include "tests/studies/methods/prototype_numbers.h"
#include "tests/studies/report/page.h"
#include "tests/studies/zwidth/on_all_cores.h"

namespace telenano::studies {
namespace {

using control::Method;

constexpr double kPrototypeRttS = 0.1;

/// "3.2 mJ", "4.1 J"
std::string energy(double j) {
  if (j == 0) return "0";
  return j < 1 ? fmt::format("{:.3g} mJ", 1e3 * j) : fmt::format("{:.3g} J", j);
}

const WorstAttack* worst(const std::vector<WorstAttack>& attacks, Method method, double rtt_s,
                         const Channel* channel) {
  const WorstAttack* found = nullptr;
  for (const WorstAttack& a : attacks) {
    if (a.config.method != method || (rtt_s >= 0 && a.config.rtt_s != rtt_s) ||
        (channel != nullptr && a.config.channel != *channel))
      continue;
    if (found == nullptr || a.outcome.extracted_j > found->outcome.extracted_j) found = &a;
  }
  return found;
}

}  // namespace

std::vector<WorstAttack> run_attacks(const std::vector<Method>& methods, const std::vector<double>& rtt_ms,
                                     bool quick, std::uint64_t seed) {
  std::vector<WorstAttack> attacks;
  for (const double rtt : rtt_ms) {
    for (const Method method : methods) {
      for (const Channel channel : kChannels) {
        WorstAttack a;
        a.config.method = method;
        a.config.rtt_s = 1e-3 * rtt;
        a.config.channel = channel;
        a.config.seed = seed + attacks.size();
        attacks.push_back(a);
      }
    }
  }
  AttackEffort effort;
  if (quick) effort = {2, 3, 10};
  on_all_cores(attacks.size(), [&](std::size_t i) { attacks[i] = worst_attack(attacks[i].config, effort); });
  return attacks;
}

std::string attack_csv(const std::vector<WorstAttack>& attacks) {
  std::string csv =
      "method,rtt_ms,channel,extracted_mj,given_mj,generated_mj,promised_mj,limits_kept,attacks,steps,hand\n";
  for (const WorstAttack& a : attacks) {
    const bool claims = control::claims_energy_bound(a.config.method);
    csv +=
        fmt::format("{},{:g},{},{:.6g},{:.6g},{:.6g},{},{},{},{},\"{}\"\n",
                    control::method_name(a.config.method), 1e3 * a.config.rtt_s,
                    channel_name(a.config.channel), 1e3 * a.outcome.extracted_j, 1e3 * a.outcome.given_j,
                    1e3 * a.generated_j, claims ? fmt::format("{:g}", 1e3 * promised_bound_j(a.config)) : "",
                    a.limits_kept ? "yes" : "no", a.attacks, a.steps, a.hand);
  }
  return csv;
}

std::vector<const WorstAttack*> broken_promises(const std::vector<WorstAttack>& attacks) {
  std::vector<const WorstAttack*> broken;
  for (const WorstAttack& a : attacks) {
    // Rounding: the accounts' terms are of some millijoules, 1e7 of them sum to below 1e-12 J of error.
    if (control::claims_energy_bound(a.config.method) &&
        a.outcome.extracted_j > promised_bound_j(a.config) + 1e-12)
      broken.push_back(&a);
  }
  return broken;
}

std::string attack_section(const std::vector<WorstAttack>& attacks) {
  std::vector<Method> methods;
  std::vector<double> rtts;
  std::int64_t count = 0, steps = 0;
  for (const WorstAttack& a : attacks) {
    if (std::find(methods.begin(), methods.end(), a.config.method) == methods.end())
      methods.push_back(a.config.method);
    if (std::find(rtts.begin(), rtts.end(), a.config.rtt_s) == rtts.end()) rtts.push_back(a.config.rtt_s);
    count += a.attacks;
    steps += a.steps;
  }
  const AttackConfig plain;
  std::string html = fmt::format(
      "<h2>What a hand can get out</h2>\n<p>Hands that mean harm, up to {:g} m/s, against the whole system "
      "with the wall behind it: sines, squares, telegraphs, hands that go with the force, passive masses and "
      "springs with resonances up to 450 Hz, and hill climbing from the best of them, white and below 20 Hz; "
      "over an ideal link, with jitter, with bursts of loss, with a link that drops out of spite (while the "
      "force goes with the hand no news gets through), with a server that is killed and started again, and "
      "with jitter, bursts and restarts at once. {} sessions, {:.3g} million steps. Energy is summed on true "
      "positions with the "
      "force that really acted; what the device's own damping certainly took is not counted. Methods that "
      "promise a bound promise an allowance of {:g} mJ: ks-clamp, which looks at one port, once, the others "
      "once for each side.</p>\n",
      plain.hand.velocity_max_m_s, count, 1e-6 * static_cast<double>(steps), 1e3 * plain.allowance_j);
  const auto broken = broken_promises(attacks);
  const bool kept = std::all_of(attacks.begin(), attacks.end(), [](const auto& a) { return a.limits_kept; });
  html += broken.empty()
              ? std::string("<p><b>No promise was found broken.</b></p>\n")
              : fmt::format(
                    "<p class=\"note\"><b>{} promises were found broken.</b> The worst: {}</p>\n",
                    broken.size(), [&] {
                      const WorstAttack& w =
                          **std::max_element(broken.begin(), broken.end(), [](const auto* a, const auto* b) {
                            return a->outcome.extracted_j < b->outcome.extracted_j;
                          });
                      return fmt::format("{} at {:g} ms, {}: {} by {}", control::method_name(w.config.method),
                                         1e3 * w.config.rtt_s, channel_name(w.config.channel),
                                         energy(w.outcome.extracted_j), w.hand);
                    }());
  html +=
      kept ? "<p>Force limit, slew and running sums of energy held in every step of every method.</p>\n"
           : "<p class=\"note\"><b>Force limit, slew or the running sums of energy did not hold.</b></p>\n";
  html += "<div class=\"scroll\"><table>\n<thead><tr><th>round trip, ms</th>";
  for (const Method m : methods) html += fmt::format("<th>{}</th>", control::method_name(m));
  html += "</tr></thead>\n<tbody>\n";
  for (const double rtt : rtts) {
    html += fmt::format("<tr><th>{:g}</th>", 1e3 * rtt);
    for (const Method m : methods) {
      const WorstAttack* w = worst(attacks, m, rtt, nullptr);
      if (w == nullptr) {
        html += "<td>–</td>";
      } else if (w->outcome.extracted_j == 0) {
        html += "<td>0</td>";
      } else {
        html += fmt::format("<td>{}: {}, {}</td>", energy(w->outcome.extracted_j),
                            channel_name(w->config.channel), html_escaped(w->hand));
      }
    }
    html += "</tr>\n";
  }
  html +=
      "</tbody></table></div>\n<p>The most by channel, over all round trips:</p>\n<div "
      "class=\"scroll\"><table>\n<thead><tr><th>method</th>";
  for (const Channel channel : kChannels) html += fmt::format("<th>{}</th>", channel_name(channel));
  html += "<th>made between the ports, at most</th></tr></thead>\n<tbody>\n";
  for (const Method m : methods) {
    html += fmt::format("<tr><th>{}</th>", control::method_name(m));
    for (const Channel channel : kChannels) {
      const WorstAttack* w = worst(attacks, m, -1, &channel);
      const bool any = w != nullptr && w->outcome.extracted_j > 0;
      html +=
          any ? fmt::format("<td>{} at {:g} ms</td>", energy(w->outcome.extracted_j), 1e3 * w->config.rtt_s)
              : std::string("<td>0</td>");
    }
    double generated_j = 0;
    for (const WorstAttack& a : attacks) {
      if (a.config.method == m) generated_j = std::max(generated_j, a.generated_j);
    }
    html += fmt::format("<td>{}</td>", energy(generated_j));
    html += "</tr>\n";
  }
  html += fmt::format(
      "</tbody></table></div>\n<p>Made between the ports: what hand and wall had got together. Only a method "
      "that balances both ports bounds it; the wall holds some 70 mJ where its own force limit stops the "
      "tip, "
      "and methods that look at the hand's port alone press it for nothing.</p>\n<p>To beat: what a hostile "
      "hand took from a prototype of this architecture at "
      "{:g} ms (not measured by this program): ",
      1e3 * kPrototypeRttS);
  for (std::size_t i = 0; i < kPrototypeExtraction.size(); ++i) {
    html += fmt::format("{}{} {}", i == 0 ? "" : ", ", control::method_name(kPrototypeExtraction[i].method),
                        kPrototypeExtraction[i].energy);
  }
  return html + ".</p>\n";
}

}  // namespace telenano::studies

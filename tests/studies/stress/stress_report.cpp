#include "tests/studies/stress/stress_report.h"

#include <fmt/format.h>
#include <sys/utsname.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <thread>

#include "tests/studies/report/page.h"
#include "tests/studies/stress/hunt.h"
#include "tests/studies/stress/report_figures.h"
#include "tests/studies/stress/results.h"
#include "tests/studies/stress/sampled_bounds.h"
#include "tests/studies/stress/summary.h"
#include "tests/studies/stress/sweep.h"

namespace telenano::studies::stress {
namespace {

std::string table(const std::string& head, const std::string& body) {
  return "<div class=\"scroll\"><table>\n<thead><tr>" + head + "</tr></thead>\n<tbody>\n" + body +
         "</tbody></table></div>\n";
}

std::string energy(double mj) {
  if (mj == 0) return "0";
  return std::fabs(mj) < 1000 ? fmt::format("{:.3g} mJ", mj) : fmt::format("{:.3g} J", 1e-3 * mj);
}

std::string summary_table(const std::vector<MethodSummary>& all) {
  std::string body;
  for (const MethodSummary& s : all) {
    const bool claims = control::claims_energy_bound(s.method);
    body += fmt::format(
        "<tr><th>{}</th><td>{}</td><td>{}</td><td>{:.2g} %</td><td>{:.1f} "
        "%</td><td>{}</td><td>{}</td><td>{}</td>"
        "<td>{}</td><td>{}</td></tr>\n",
        control::method_name(s.method), s.runs, s.broken, 100 * s.rate_at_most(),
        100.0 * static_cast<double>(s.survived) / static_cast<double>(s.runs), s.stopped,
        energy(s.most_extracted_mj), claims ? energy(s.most_allowed_mj) : std::string("nothing"),
        energy(s.least_margin_mj),
        s.slowest_recovery_s >= 0 ? fmt::format("{:.2f} s", s.slowest_recovery_s) : std::string("–"));
  }
  return table(
      "<th>method</th><th>runs</th><th>broken promises</th><th>rate below, at 95 %</th><th>no invariant "
      "violated</th><th>stopped</th><th>most extracted</th><th>promised</th><th>least margin</th><th>slowest "
      "recovery</th>",
      body);
}

std::string invariant_table(const std::vector<MethodSummary>& all) {
  std::string head = "<th>method</th>", body;
  for (int i = 0; i < kInvariants; ++i) head += fmt::format("<th>{}</th>", invariant_name(1u << i));
  head += "<th>ticks at the clamp</th><th>at the force limit</th><th>stopped</th>";
  for (const MethodSummary& s : all) {
    body += fmt::format("<tr><th>{}</th>", control::method_name(s.method));
    for (int i = 0; i < kInvariants; ++i) {
      const bool held = (promised(s.method) >> i) & 1u;
      const std::size_t count = s.violated[static_cast<std::size_t>(i)];
      body += !held        ? fmt::format("<td>({})</td>", count)
              : count == 0 ? std::string("<td>0</td>")
                           : fmt::format("<td><b>{}</b></td>", count);
    }
    const auto share = [&](std::int64_t ticks) {
      return fmt::format("<td>{:.2g} %</td>",
                         100.0 * static_cast<double>(ticks) / static_cast<double>(s.ticks));
    };
    body += share(s.clamp_ticks) + share(s.limit_ticks) + share(s.stop_ticks) + "</tr>\n";
  }
  return table(head, body);
}

std::string worst_table(const std::vector<Row>& rows, const std::vector<MethodSummary>& all) {
  std::string body;
  for (const MethodSummary& s : all) {
    std::vector<const Row*> of;
    for (const Row& row : rows) {
      if (row.spec.method == s.method) of.push_back(&row);
    }
    // Broken promises first, then by the least margin.
    std::stable_sort(of.begin(), of.end(), [&](const Row* a, const Row* b) {
      const bool broken_a = (a->outcome.violated & promised(s.method)) != 0;
      const bool broken_b = (b->outcome.violated & promised(s.method)) != 0;
      return broken_a != broken_b ? broken_a : a->outcome.margin_mj < b->outcome.margin_mj;
    });
    for (std::size_t i = 0; i < std::min<std::size_t>(of.size(), 3); ++i) {
      body += fmt::format("<tr><th>{}</th><td>{}</td><td>{}</td><td>{}</td><td><code>{}</code></td></tr>\n",
                          control::method_name(s.method), energy(of[i]->outcome.extracted_mj),
                          energy(of[i]->outcome.margin_mj), invariant_names(of[i]->outcome.violated),
                          html_escaped(replay_command(of[i]->spec)));
    }
  }
  return table("<th>method</th><th>extracted</th><th>margin</th><th>violated</th><th>runs again with</th>",
               body);
}

/// A row for each feature and value, a column for each method: the upper bound of the rate, runs in the title.
std::string rate_table(const std::vector<Row>& rows) {
  std::vector<control::Method> methods;
  std::map<std::pair<std::string, std::string>, std::map<control::Method, SampledRate>> by_value;
  for (const SampledRate& r : sampled_rates(rows)) {
    if (std::find(methods.begin(), methods.end(), r.method) == methods.end()) methods.push_back(r.method);
    by_value[{r.feature, r.value}][r.method] = r;
  }
  std::string head = "<th>runs with</th>", body;
  for (const control::Method method : methods)
    head += fmt::format("<th>{}</th>", control::method_name(method));
  for (const auto& [key, of] : by_value) {
    const auto& [feature, value] = key;
    body += fmt::format("<tr><th>{}</th>", feature.empty() ? std::string("all") : feature + ": " + value);
    for (const control::Method method : methods) {
      const auto found = of.find(method);
      if (found == of.end()) {
        body += "<td>–</td>";
        continue;
      }
      const SampledRate& r = found->second;
      body += r.broken == 0 ? fmt::format("<td>0 of {}: below {:.2g} %</td>", r.runs, 100 * r.high)
                            : fmt::format("<td><b>{} of {}: {:.2g} to {:.2g} %</b></td>", r.broken, r.runs,
                                          100 * r.low, 100 * r.high);
    }
    body += "</tr>\n";
  }
  return table(head, body);
}

std::string mutant_table(const std::vector<Hunt>& hunts) {
  std::string body;
  for (const Hunt& h : hunts) {
    body +=
        fmt::format("<tr><th>{}</th><td>{}</td><td>{}</td><td>{}</td><td><code>{}</code></td></tr>\n",
                    mutant_name(h.mutant), h.survived() ? "<b>nothing</b>" : invariant_names(h.caught_by),
                    h.runs, h.survived() ? std::string("–") : fmt::format("{:.3f} s", h.outcome.violated_s),
                    h.survived() ? std::string() : html_escaped(replay_command(h.spec)));
  }
  return table(
      "<th>wrong on purpose</th><th>found out by</th><th>runs until then</th><th>after</th><th>runs again "
      "with</th>",
      body);
}

}  // namespace

std::string machine_text() {
  std::string model = "unknown processor";
  std::ifstream in("/proc/cpuinfo");
  for (std::string line; std::getline(in, line);) {
    if (line.rfind("model name", 0) != 0) continue;
    model = line.substr(line.find(':') + 2);
    break;
  }
  utsname name{};
  ::uname(&name);
  return fmt::format("{}, {} cores, {} {}", model, std::thread::hardware_concurrency(), name.sysname,
                     name.release);
}

void write_report(const ReportOptions& options, const std::vector<Row>& rows) {
  const FigureFolder page(options.folder / "report");
  const FigureFolder folder(options.folder / "report" / "data");
  if (!folder.has_gnuplot())
    std::fprintf(stderr, "stress: gnuplot is not installed: numbers only, no figures\n");
  const auto all = summarise(rows);
  const Scenes scenes(options.scenes, {SceneKind::kWall});
  std::size_t broken = 0, repeated = 0;
  double simulated_s = 0;
  std::int64_t ticks = 0;
  for (const MethodSummary& s : all) {
    broken += s.broken;
    repeated += s.repeated;
    simulated_s += s.simulated_s;
    ticks += s.ticks;
  }
  const std::string took = timing_text(options.folder);
  std::string html =
      page_begin("Stress", html_escaped(fmt::format("{}; {}", options.manifest, machine_text())));
  html += fmt::format(
      "<p>{} runs, {:.3g} million steps of the whole loop, {:.3g} hours of sessions in virtual time, with "
      "the station, session, server and "
      "slave of the programs. Hands: tasks of a person with and without tremor, passive masses and springs "
      "up to 450 Hz, hands that "
      "mean harm, hill climbing. Links: delay to 1 s, jitter, bursts of loss, reordering, duplicates, "
      "drifting and leaping clocks, "
      "outages to 10 s, servers that die, late ticks, and links that drop with knowledge of the state; "
      "replies "
      "shown when they come or played out, commands repeated or held back by a deadband, replies left out "
      "within one. What must hold was "
      "held, at "
      "every sample, against true positions and the forces that really acted, summed in long double by code "
      "that shares nothing with the "
      "product. {} runs were made twice and gave the same bits. {}</p>\n",
      rows.size(), 1e-6 * static_cast<double>(ticks), simulated_s / 3600, repeated,
      took.empty() ? took : "Computed: " + took + ".");
  html +=
      broken == 0
          ? std::string("<p><b>No promise was found broken.</b></p>\n")
          : fmt::format("<p class=\"note\"><b>{} promises were found broken</b>: see the worst cases.</p>\n",
                        broken);
  html += "<h2>Methods</h2>\n" + summary_table(all);
  html +=
      "<p>A promise: <i>energy</i> for methods that bound what a hand can extract (E₀ for one port, 2E₀ for "
      "both, plus Q of the "
      "encoder and what a late tick may overdraw once, for hands no faster than 0.5 m/s); every other "
      "invariant for all methods "
      "(<i>damper</i>: not <code>ks</code> as published). Where a sample's potential falls (a tip that snaps "
      "in), <code>tank</code>, "
      "<code>wave</code> and the baselines pass on what it gives, at the scale of the run; that much more is "
      "then allowed to them, by the "
      "slave's account (which has tests of its own); <code>ks-clamp</code> pays for every "
      "force from the hand's port and "
      "is allowed none of it. The rate is the upper bound of Clopper and Pearson: what so many independent "
      "runs would show at 95 %. ";
  html +=
      options.sample
          ? "These runs are independent draws, so it is a bound of a probability, for such draws.</p>\n"
          : "The runs of a profile are a grid, chosen and not drawn, so it says how many they are, and is "
            "no bound of a probability; <code>--sample</code> draws.</p>\n";
  if (options.sample)
    html +=
        "<h2>Rates</h2>\n<p>Runs that broke a promise, over all and in each kind of run, with the bounds of "
        "the rate at 95 % (Clopper and Pearson, 2.5 % on each side). Each cell is right by itself: of twenty "
        "cells one may be off. The same numbers are in bounds.csv.</p>\n" +
        rate_table(rows);
  html += figure_html(survival_figure(rows, folder));
  html += figure_html(round_trip_figure(rows, folder));
  html += figure_html(error_figure(rows, scenes, folder));
  html += figure_html(budget_figure(scenes, folder));
  html +=
      "<h2>Invariants</h2>\n<p>Runs in which each was violated; in brackets where the method does not "
      "promise it.</p>\n" +
      invariant_table(all);
  html += "<h2>Worst cases</h2>\n<p>Broken promises first, then by the margin that was left.</p>\n" +
          worst_table(rows, all);
  const auto hunts = hunt_mutants(scenes, 1, 0);
  html +=
      "<h2>Wrong on purpose</h2>\n<p>Controllers, devices and slaves with a known fault. A suite that does "
      "not find each of them out would prove "
      "nothing; the right one passes the same run.</p>\n" +
      mutant_table(hunts);
  page.write("index.html", html + page_end());
}

}  // namespace telenano::studies::stress

#include "tests/studies/fidelity/fidelity_page.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "telenano/common/control/scaling_plan.h"
#include "tests/studies/report/gnuplot.h"
#include "tests/studies/report/page.h"
#include "tests/studies/stress/invariants.h"

namespace telenano::studies::fidelity {
namespace {

using control::Method;

template <class T, class Get>
std::vector<T> distinct(const std::vector<CellResult>& results, const Get& get) {
  std::vector<T> list;
  for (const CellResult& r : results) {
    if (std::find(list.begin(), list.end(), get(r)) == list.end()) list.push_back(get(r));
  }
  return list;
}

std::string full_name(const SceneMotion& m) {
  return std::string(m.scene) + ", " + m.motion;
}

struct Shade {
  double to;  // NRMSE, up to and including
  const char* colour;
  const char* ink;
};
// From what is asked to what is not the sample any more; the steps differ in lightness too.
constexpr Shade kShades[] = {{0.02, "#0B6E4F", "#fff"}, {0.05, "#58A684", "#fff"},
                             {0.1, "#B7DDB0", "#222"},  {0.2, "#F6E8A6", "#222"},
                             {0.5, "#F0A35E", "#222"},  {1e300, "#B6322A", "#fff"}};

const Shade& shade(double nrmse) {
  for (const Shade& s : kShades) {
    if (nrmse <= s.to) return s;
  }
  return kShades[std::size(kShades) - 1];
}

std::string heat_cell(const CellResult* r) {
  if (r == nullptr || !std::isfinite(r->metrics.nrmse)) return "<td class=h5>no touch</td>";
  std::string marks;
  if (r->run.stopped_s >= 0) marks += " ■";
  if (r->metrics.false_releases > 0) marks += " ○";
  const auto at = static_cast<std::size_t>(&shade(r->metrics.nrmse) - kShades);
  return fmt::format("<td class=h{}>{:.2g}{}</td>", at, r->metrics.nrmse, marks);
}

std::string heat_maps(const std::vector<CellResult>& results, double loss) {
  const auto methods = distinct<Method>(results, [](const CellResult& r) { return r.cell.method; });
  const auto rtts = distinct<double>(results, [](const CellResult& r) { return r.cell.rtt_ms; });
  const auto motions =
      distinct<const SceneMotion*>(results, [](const CellResult& r) { return r.cell.motion; });
  std::string head = "<tr><th rowspan=2>scene, motion</th>", second = "<tr>";
  for (const Method m : methods) {
    head += fmt::format("<th colspan={}>{}</th>", rtts.size(), control::method_name(m));
    for (const double rtt : rtts) second += fmt::format("<th>{:g}</th>", rtt);
  }
  std::string body;
  for (const SceneMotion* motion : motions) {
    body += "<tr><th>" + full_name(*motion) + "</th>";
    for (const Method m : methods) {
      for (const double rtt : rtts) {
        const auto found = std::find_if(results.begin(), results.end(), [&](const CellResult& r) {
          return r.cell.motion == motion && r.cell.method == m && r.cell.rtt_ms == rtt && r.cell.loss == loss;
        });
        body += heat_cell(found != results.end() ? &*found : nullptr);
      }
    }
    body += "</tr>\n";
  }
  return fmt::format(
      "<h3>Loss {:g} %</h3>\n<div class=\"scroll\"><table class=heat>\n<thead>{}</tr>\n{}</tr></thead>\n"
      "<tbody>\n{}</tbody></table></div>\n",
      100 * loss, head, second, body);
}

std::string heat_style() {
  std::string css =
      "<style>table.heat{border-collapse:separate;border-spacing:1px}"
      "table.heat td{text-align:right;padding:1px 5px;font-variant-numeric:tabular-nums}";
  for (std::size_t i = 0; i < std::size(kShades); ++i)
    css += fmt::format(".h{}{{background:{};color:{}}}", i, kShades[i].colour, kShades[i].ink);
  return css + "</style>\n";
}

std::string heat_key() {
  std::string key = "<p>NRMSE of the force: ";
  double from = 0;
  for (std::size_t i = 0; i < std::size(kShades); ++i) {
    const bool last = i + 1 == std::size(kShades);
    key += fmt::format("<span class=h{}>&nbsp;{}&nbsp;</span> ", i,
                       last ? fmt::format("above {:g}", from) : fmt::format("to {:g}", kShades[i].to));
    from = kShades[i].to;
  }
  return key +
         "— 0: felt as it is; 1: as wrong as no force at all. Columns: round trip in ms. ○ the force was "
         "lost "
         "in the middle of a contact, ■ the station stopped.</p>\n";
}

constexpr double kBeforeS = 0.2, kShownS = 2.8;
constexpr std::size_t kEveryTick = 10;  // some pixels wide

std::vector<const CellResult*> drawn(const std::vector<CellResult>& results) {
  std::vector<const CellResult*> list;
  for (const CellResult& r : results) {
    if (!r.run.trace.rows.empty()) list.push_back(&r);
  }
  return list;
}

Figure felt_figure(const std::vector<CellResult>& results, const FigureFolder& folder) {
  const std::vector<const CellResult*> traced = drawn(results);
  Figure figure{"felt", "What a hand feels", "", ""};
  if (traced.empty()) return figure;
  const Cell& cell = traced.front()->cell;
  figure.caption = fmt::format(
      "{}, round trip {:g} ms, no loss. Left the force across the ground (y runs up the image, x along the "
      "lines), "
      "right the force along the normal, N at the hand, over time. Dark: the sample itself at that hand's "
      "own path; "
      "orange: what was felt. From the first touch on; each hand yields to what it feels, so that paths "
      "differ.",
      full_name(*cell.motion), cell.rtt_ms);
  std::string csv = "# time_s,true_x_n,felt_x_n,true_z_n,felt_z_n; one block a method\n";
  double low[2] = {0, 0}, high[2] = {0, 0};
  for (const CellResult* r : traced) {
    const auto& rows = r->run.trace.rows;
    const double period_s = r->run.trace.period_s;
    // From shortly before the first touch, for as long as two lines take.
    const auto touch = std::find_if(rows.begin(), rows.end(), [](const auto& row) { return row.touches; });
    const auto tick = [&](double s) { return static_cast<std::size_t>(std::llround(s / period_s)); };
    const auto touched = static_cast<std::size_t>(touch - rows.begin());
    const std::size_t from = touched > tick(kBeforeS) ? touched - tick(kBeforeS) : 0;
    for (std::size_t i = from; i < std::min(rows.size(), from + tick(kShownS)); i += kEveryTick) {
      csv +=
          fmt::format("{:.4g},{:.3g},{:.3g},{:.3g},{:.3g}\n", period_s * static_cast<double>(i - from),
                      rows[i].true_h_n.x(), rows[i].felt_h_n.x(), rows[i].true_h_n.z(), rows[i].felt_h_n.z());
      for (int axis = 0; axis < 2; ++axis) {
        low[axis] = std::min(low[axis], rows[i].true_h_n[2 * axis]);
        high[axis] = std::max(high[axis], rows[i].true_h_n[2 * axis]);
      }
    }
    csv += "\n\n";
  }
  folder.write("felt.csv", csv);
  std::string script = "set multiplot\n";
  const double count = static_cast<double>(traced.size());
  const double height = 0.9 / count;
  for (std::size_t i = 0; i < traced.size(); ++i) {
    const double top = 0.96 - static_cast<double>(i) * height;
    for (int side = 0; side < 2; ++side) {
      script += fmt::format(
          "set lmargin at screen {:.4f}\nset rmargin at screen {:.4f}\nset tmargin at screen {:.4f}\n"
          "set bmargin at screen {:.4f}\nset xrange [0:{:.4g}]\n{}",
          side == 0 ? 0.10 : 0.58, side == 0 ? 0.50 : 0.98, top - 0.12 * height, top - 0.9 * height, kShownS,
          y_range(1.3 * low[side], 1.3 * high[side]));
      script += i == 0 && side == 0 ? "set key top left Left reverse horizontal\n" : "unset key\n";
      script +=
          i + 1 < traced.size() ? "set format x ''\n" : "set format x '%g'\nset xlabel 's' offset 0,0.5\n";
      script += side == 0
                    ? fmt::format("set ylabel {}\n",
                                  quoted(fmt::format("{}: x", control::method_name(traced[i]->cell.method))))
                    : "set ylabel 'z'\n";
      script += fmt::format("set label 1 'NRMSE {:.2g}' at graph 0.99, graph 0.92 right\n",
                            side == 0 ? traced[i]->metrics.nrmse_x : traced[i]->metrics.nrmse_z);
      script += fmt::format(
          "plot 'felt.csv' index {0} using 1:{1} lc rgb '{3}' lw 1.6 title 'true', "
          "'' index {0} using 1:{2} lc rgb '{4}' lw 1.2 title 'felt'\n",
          i, side == 0 ? 2 : 4, side == 0 ? 3 : 5, kInk, kRed);
    }
  }
  folder.draw(figure, 1000, 60 + 150 * static_cast<int>(traced.size()), script + "unset multiplot\n");
  return figure;
}

/// The worst over all motions, by round trip: what one may count on.
Figure worst_figure(const std::vector<CellResult>& results, const FigureFolder& folder) {
  const auto methods = distinct<Method>(results, [](const CellResult& r) { return r.cell.method; });
  const auto rtts = distinct<double>(results, [](const CellResult& r) { return r.cell.rtt_ms; });
  Figure figure{
      "worst", "By round trip",
      "Without loss. Line: the mean over all motions of the NRMSE; upper end of each bar: the worst of them. "
      "Dashed: 0.02.",
      ""};
  std::string csv = "# place,rtt_ms,mean,worst; one block a method\n", tics, curves;
  for (std::size_t i = 0; i < rtts.size(); ++i)
    tics += fmt::format("{}'{:g}' {}", i == 0 ? "" : ", ", rtts[i], i);
  static constexpr const char* kColours[] = {kGrey, kInk, kGreen, kPurple, kRed, kBlue, kPale};
  for (std::size_t b = 0; b < methods.size(); ++b) {
    for (std::size_t i = 0; i < rtts.size(); ++i) {
      double sum = 0, worst = 0;
      int count = 0;
      for (const CellResult& r : results) {
        if (r.cell.method != methods[b] || r.cell.rtt_ms != rtts[i] || r.cell.loss != 0) continue;
        if (!std::isfinite(r.metrics.nrmse)) continue;
        sum += r.metrics.nrmse;
        worst = std::max(worst, r.metrics.nrmse);
        ++count;
      }
      if (count > 0)
        csv += fmt::format("{:.3f},{:g},{:.4g},{:.4g}\n",
                           static_cast<double>(i) +
                               0.08 * (static_cast<double>(b) - 0.5 * static_cast<double>(methods.size())),
                           rtts[i], sum / count, worst);
    }
    csv += "\n\n";
    const char* colour = kColours[b % std::size(kColours)];
    curves += fmt::format(
        "{0}'worst.csv' index {1} using 1:3 with linespoints pt 7 ps 0.6 lw 2 lc rgb '{2}' title '{3}', "
        "'' index {1} using 1:3:3:4 with yerrorbars pt 0 lw 1 lc rgb '{2}' notitle",
        b == 0 ? "plot " : ", \\\n  ", b, colour, control::method_name(methods[b]));
  }
  folder.write("worst.csv", csv);
  folder.draw(
      figure, 900, 420,
      fmt::format(
          "set lmargin 10\nset bmargin 4\nset tmargin 2\nset logscale y\nset xtics ({})\nset xrange "
          "[-0.5:{}]\n"
          "set yrange [0.001:3]\nset xlabel 'round trip (ms)'\nset ylabel 'NRMSE of the force'\n"
          "set key outside right top\nset arrow from graph 0, first 0.02 to graph 1, first 0.02 nohead dt "
          "(4,4) lc rgb '#888888'\n",
          tics, static_cast<double>(rtts.size()) - 0.5) +
          curves + "\n");
  return figure;
}

/// Medians over all motions of what haptic communication measures, a row for each method, round trip and loss.
std::string haptic_table(const std::vector<CellResult>& results) {
  const auto median = [](std::vector<double> values) {
    std::erase_if(values, [](double value) { return !std::isfinite(value); });
    if (values.empty()) return FeltMetrics::kNone;
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
  };
  constexpr auto kColumns = std::to_array<double (*)(const CellResult&)>({
      [](const CellResult& r) { return r.metrics.nrmse; },
      [](const CellResult& r) { return r.metrics.lag_ms; },
      [](const CellResult& r) { return r.haptic.effective_delay_ms; },
      [](const CellResult& r) { return r.haptic.effective_delay_derivative; },
      [](const CellResult& r) { return r.haptic.effective_nrmse; },
      [](const CellResult& r) { return r.haptic.time_offset_ms; },
      [](const CellResult& r) { return r.haptic.value_gain; },
      [](const CellResult& r) { return r.haptic.value_offset_n; },
      [](const CellResult& r) { return 100 * r.haptic.weber_sent_share; },
      [](const CellResult& r) { return r.haptic.weber_nrmse; },
  });
  std::string body;
  for (const double loss : distinct<double>(results, [](const CellResult& r) { return r.cell.loss; })) {
    for (const Method m : distinct<Method>(results, [](const CellResult& r) { return r.cell.method; })) {
      for (const double rtt : distinct<double>(results, [](const CellResult& r) { return r.cell.rtt_ms; })) {
        body += fmt::format("<tr><th>{}</th><td>{:g}</td><td>{:g}</td>", control::method_name(m), rtt,
                            100 * loss);
        for (const auto column : kColumns) {
          std::vector<double> values;
          for (const CellResult& r : results) {
            if (r.cell.method == m && r.cell.rtt_ms == rtt && r.cell.loss == loss)
              values.push_back(column(r));
          }
          const double value = median(values);
          body += std::isfinite(value) ? fmt::format("<td>{:.3g}</td>", value) : "<td>–</td>";
        }
        body += "</tr>\n";
      }
    }
  }
  return "<h2>As haptic communication measures it</h2>\n<p>Medians over all motions. Effective delay, its "
         "change "
         "and the effective NRMSE: each felt tick beside the true one that it shows, by time warping, in the "
         "manner "
         "of ETVO. Time offset, gain and value offset: one alignment of the whole motion. Packets: the part "
         "of the "
         "samples of the true force that a perceptual deadband of 10 % sends, and what holding the last one "
         "costs.</p>\n<div class=\"scroll\"><table>\n<thead><tr><th>method</th><th>round trip, ms</th>"
         "<th>loss, %</th><th>NRMSE</th><th>lag, ms</th><th>effective delay, ms</th><th>its change a "
         "tick</th>"
         "<th>effective NRMSE</th><th>time offset, ms</th><th>gain</th><th>value offset, N</th>"
         "<th>packets, %</th><th>NRMSE of the deadband</th></tr></thead>\n<tbody>\n" +
         body + "</tbody></table></div>\n";
}

std::string worst_cells(const std::vector<CellResult>& results) {
  std::string body;
  for (const Method m : distinct<Method>(results, [](const CellResult& r) { return r.cell.method; })) {
    std::vector<const CellResult*> of;
    for (const CellResult& r : results) {
      if (r.cell.method == m && std::isfinite(r.metrics.nrmse)) of.push_back(&r);
    }
    std::sort(of.begin(), of.end(),
              [](const auto* a, const auto* b) { return a->metrics.nrmse > b->metrics.nrmse; });
    of.resize(std::min<std::size_t>(of.size(), 3));
    for (const CellResult* r : of) {
      std::string rules;
      for (const std::string& rule : broken_rules(r->metrics)) rules += (rules.empty() ? "" : "; ") + rule;
      if (r->run.stopped_s >= 0)
        rules += fmt::format("; stopped: {}", station::fault_name(r->run.stop_faults));
      body += fmt::format("<tr><th>{}</th><td>{}</td><td>{:g}</td><td>{:g}</td><td>{}</td></tr>\n",
                          control::method_name(m), full_name(*r->cell.motion), r->cell.rtt_ms,
                          100 * r->cell.loss, html_escaped(rules));
    }
  }
  return "<h2>The worst cells</h2>\n<div class=\"scroll\"><table>\n<thead><tr><th>method</th><th>scene, "
         "motion</th>"
         "<th>round trip, ms</th><th>loss, %</th><th>what is wrong</th></tr></thead>\n<tbody>\n" +
         body + "</tbody></table></div>\n";
}

std::string sensitivity_section(const std::vector<SensitivityRow>& rows) {
  if (rows.empty()) return "";
  std::string body;
  for (const SensitivityRow& row : rows) {
    std::string rules;
    for (const std::string& rule : row.rules) rules += (rules.empty() ? "" : "; ") + rule;
    body += fmt::format("<tr><th>{}</th><td>{}</td><td>{:.3g}</td><td>{}</td><td>{}</td></tr>\n",
                        wrong_renderer_name(row.wrong), row.motion, row.nrmse,
                        rules.empty() ? "–" : html_escaped(rules),
                        row.stress == 0 ? "nothing" : stress::invariant_names(row.stress));
  }
  return "<h2>Would it be found out?</h2>\n<p>Renderers that are wrong on purpose, without a link, and the "
         "sample itself (none) beside them. Last column: what the stress laboratory, which looks at energy, "
         "force "
         "limits and time, finds of the product's model made wrong likewise.</p>\n<div "
         "class=\"scroll\"><table>\n<thead><tr><th>renderer</th><th>shows most "
         "in</th>"
         "<th>NRMSE</th><th>rules broken</th><th>stress laboratory finds</th></tr></thead>\n<tbody>\n" +
         body + "</tbody></table></div>\n";
}

}  // namespace

namespace {

/// The same cell without companding; null: it was not asked for.
const CellResult* without(const std::vector<CellResult>& results, const CellResult& with) {
  const auto found = std::find_if(results.begin(), results.end(), [&](const CellResult& r) {
    return r.cell.motion == with.cell.motion && r.cell.method == with.cell.method &&
           r.cell.rtt_ms == with.cell.rtt_ms && r.cell.loss == with.cell.loss;
  });
  return found != results.end() ? &*found : nullptr;
}

}  // namespace

std::string companding_csv(const std::vector<CellResult>& results, const std::vector<CellResult>& companded) {
  std::string csv = "scene,motion,rtt_ms,loss,gain,approach_true_n,approach_felt_n,nrmse,stopped_s\n";
  const auto number = [](double value) {
    return std::isfinite(value) ? fmt::format("{:.3g}", value) : std::string();
  };
  for (const CellResult& with : companded) {
    for (const CellResult* const r : {without(results, with), &with}) {
      if (r == nullptr) continue;
      csv +=
          fmt::format("{},{},{:g},{:g},{:g},{},{},{},{:g}\n", r->cell.motion->scene, r->cell.motion->motion,
                      r->cell.rtt_ms, r->cell.loss, r->cell.compand, number(r->haptic.approach_true_n),
                      number(r->haptic.approach_felt_n), number(r->metrics.nrmse), r->run.stopped_s);
    }
  }
  return csv;
}

std::string companding_section(const std::vector<CellResult>& results,
                               const std::vector<CellResult>& companded) {
  if (companded.empty()) return "";
  std::string body;
  const auto times = [](double force_n) {
    if (!std::isfinite(force_n)) return std::string("<td>–</td>");
    return fmt::format("<td>{:.3f} ({:.1f}){}</td>", force_n, force_n / control::kNoticedForceN,
                       force_n >= control::kNoticedForceN ? " ●" : "");
  };
  for (const CellResult& with : companded) {
    const CellResult* const r = without(results, with);
    if (r == nullptr) continue;
    body += fmt::format("<tr><th>{}</th><td>{:g}</td>{}{}{}<td>{:.2g}</td><td>{:.2g}</td></tr>\n",
                        full_name(*with.cell.motion), with.cell.rtt_ms, times(r->haptic.approach_true_n),
                        times(r->haptic.approach_felt_n), times(with.haptic.approach_felt_n),
                        r->metrics.nrmse, with.metrics.nrmse);
  }
  return fmt::format(
      "<h2>With companding</h2>\n<p>Method twin, no loss: the greatest attraction before the first contact, "
      "N at "
      "the hand, in brackets how many times the {:g} N that a hand notices (●: noticed): that of the sample, "
      "what is "
      "felt of it without companding, and with a gain of {:g}. Then the NRMSE without and with; with "
      "companding "
      "true is ψ′(U) F before contact, F after it.</p>\n<div class=\"scroll\"><table>\n<thead><tr><th>scene, "
      "motion</th><th>round trip, ms</th><th>sample</th><th>felt</th><th>felt, companded</th><th>NRMSE</th>"
      "<th>NRMSE, companded</th></tr></thead>\n<tbody>\n{}</tbody></table></div>\n",
      control::kNoticedForceN, companded.front().cell.compand, body);
}

std::string fidelity_sections(const std::vector<CellResult>& results,
                              const std::vector<SensitivityRow>& sensitivity, const FigureFolder& folder) {
  std::string html = heat_style();
  const Figure felt = felt_figure(results, folder);
  if (!felt.caption.empty()) html += "<h2>" + felt.title + "</h2>\n" + figure_html(felt);
  if (!results.empty()) {
    const Figure worst = worst_figure(results, folder);
    html += "<h2>" + worst.title + "</h2>\n" + figure_html(worst);
    html += "<h2>Where it is felt as it is</h2>\n" + heat_key();
    for (const double loss : distinct<double>(results, [](const CellResult& r) { return r.cell.loss; }))
      html += heat_maps(results, loss);
    html += haptic_table(results);
    html += worst_cells(results);
  }
  return html + sensitivity_section(sensitivity);
}

}  // namespace telenano::studies::fidelity

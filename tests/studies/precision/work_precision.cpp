#include "tests/studies/precision/work_precision.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>

#include "tests/studies/report/gnuplot.h"
#include "tests/studies/report/page.h"

namespace telenano::studies {
namespace {

using Clock = std::chrono::steady_clock;

constexpr double kFloor = 1e-17;  // an error of zero on a logarithmic axis
constexpr const char* kColours[] = {kBlue,     kRed,      kGreen,    kPurple,   kInk,
                                    "#E69F00", "#56B4E9", "#8C6D1F", "#CC79A7", "#7F7F7F",
                                    "#66A61E", "#1B4F9C", "#B2182B", "#00A08A"};
constexpr int kPoints[] = {7, 5, 9, 13, 11, 15, 6, 4, 8, 10, 12, 14, 5, 13};
constexpr std::size_t kStyles = std::size(kColours);

std::vector<std::string> distinct(const std::vector<std::string>& names) {
  std::vector<std::string> result;
  for (const std::string& name : names) {
    if (std::find(result.begin(), result.end(), name) == result.end()) result.push_back(name);
  }
  return result;
}

double seconds_since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

/// Panels side by side, two in a row, and the legend in a column of its own at the right.
std::string panel_grid(const std::vector<std::string>& panels,
                       const std::function<std::string(const std::string&)>& plot_of,
                       const std::vector<std::string>& families, const LineAxes& axes, int height) {
  const std::size_t columns = std::min<std::size_t>(2, panels.size());
  const std::size_t rows = (panels.size() + columns - 1) / columns;
  const double right = 0.76;
  const double left = 0.075;
  const double gap_x = 0.02 + (columns > 1 ? 0.05 : 0);
  const double width =
      (right - left - gap_x * static_cast<double>(columns - 1)) / static_cast<double>(columns);
  const double top = 1.0 - 30.0 / height;
  const double bottom = 60.0 / height;
  const double gap_y = 62.0 / height;
  const double tall = (top - bottom - gap_y * static_cast<double>(rows - 1)) / static_cast<double>(rows);
  std::string script = "set multiplot\nset logscale xy\nset format y '10^{%T}'\nunset key\n" + axes.settings;
  for (std::size_t i = 0; i < panels.size(); ++i) {
    const std::size_t row = i / columns;
    const std::size_t column = i % columns;
    const double x0 = left + static_cast<double>(column) * (width + gap_x);
    const double y1 = top - static_cast<double>(row) * (tall + gap_y);
    const bool lowest = i + columns >= panels.size();
    script += fmt::format(
        "set lmargin at screen {:.4f}\nset rmargin at screen {:.4f}\nset tmargin at screen {:.4f}\nset "
        "bmargin at screen {:.4f}\nset title {} noenhanced offset 0,-0.6 font ',12'\n{}{}",
        x0, x0 + width, y1, y1 - tall, quoted(panels[i]),
        lowest ? fmt::format("set xlabel {} offset 0,0.3\n", quoted(axes.x)) : std::string("unset xlabel\n"),
        column == 0 ? fmt::format("set ylabel {} offset 1,0\n", quoted(axes.y))
                    : std::string("unset ylabel\n"));
    script += plot_of(panels[i]) + "\n";
  }
  // An empty panel that carries only the legend.
  script += fmt::format(
      "set lmargin at screen {:.4f}\nset rmargin at screen 0.99\nset tmargin at screen {:.4f}\nset bmargin "
      "at screen {:.4f}\nunset title\nunset xlabel\nunset ylabel\nunset border\nunset tics\nunset "
      "grid\nunset logscale\nset key at graph 0,1 top left Left reverse vertical samplen 2 spacing 1.3 "
      "noenhanced\nset xrange [0:1]\nset yrange [0:1]\nplot ",
      right + 0.02, top, bottom);
  for (std::size_t f = 0; f < families.size(); ++f) {
    script +=
        fmt::format("{}NaN with linespoints lc rgb '{}' pt {} ps 0.7 lw 1.4 title {}", f == 0 ? "" : ", ",
                    kColours[f % kStyles], kPoints[f % kStyles], quoted(families[f]));
  }
  return script;
}

/// Two panels a row, and room for the legend.
int height_of(std::size_t panels, std::size_t families) {
  const int rows = static_cast<int>((panels + 1) / 2);
  return std::max(100 + 250 * rows, 100 + 36 * static_cast<int>(families));
}

std::string number(double value) {
  return std::isfinite(value) ? fmt::format("{:.2g}", value) : std::string("–");
}

}  // namespace

Cost measure(const std::function<void()>& block, std::size_t evaluations, const Effort& effort) {
  block();  // caches and clocks warm
  const auto begin = Clock::now();
  block();
  const double once_s = std::max(1e-7, seconds_since(begin));
  // Blocks of 20 us or more, so that reading the clock (30 ns) does not count; as many as the time allows.
  const int inner = std::max(1, static_cast<int>(20e-6 / once_s));
  const double budget_s = effort.quick ? 0.004 : 0.12;
  const int blocks = std::clamp(static_cast<int>(budget_s / (inner * once_s)), 3, 2000);
  std::vector<double> ns;
  for (int i = 0; i < blocks; ++i) {
    const auto start = Clock::now();
    for (int k = 0; k < inner; ++k) block();
    ns.push_back(1e9 * seconds_since(start) / (static_cast<double>(evaluations) * inner));
  }
  std::sort(ns.begin(), ns.end());
  return {ns[ns.size() / 2], ns[std::min(ns.size() - 1, ns.size() * 99 / 100)]};
}

Errors summarise(std::vector<double> errors) {
  Errors result;
  result.points = static_cast<int>(errors.size());
  const auto end = std::partition(errors.begin(), errors.end(), [](double e) { return std::isfinite(e); });
  result.failures = static_cast<int>(errors.end() - end);
  errors.erase(end, errors.end());
  if (errors.empty()) {
    result.largest = result.p99 = result.median = HUGE_VAL;
    return result;
  }
  std::sort(errors.begin(), errors.end());
  result.largest = errors.back();
  result.p99 = errors[std::min(errors.size() - 1, errors.size() * 99 / 100)];
  result.median = errors[errors.size() / 2];
  return result;
}

void write_rows(const Section& section, const FigureFolder& folder) {
  std::string text =
      "condition,method,setting,default,error_max,error_p99,error_p50,failures,points,p50_ns,p99_ns,setup_"
      "us\n";
  for (const Row& row : section.rows) {
    text += fmt::format("\"{}\",\"{}\",\"{}\",{},{:.4g},{:.4g},{:.4g},{},{},{:.4g},{:.4g},{:.4g}\n",
                        row.condition, row.family, row.setting, row.is_default ? 1 : 0, row.errors.largest,
                        row.errors.p99, row.errors.median, row.errors.failures, row.errors.points,
                        row.cost.p50_ns, row.cost.p99_ns, row.setup_us);
  }
  folder.write(section.id + "_rows.csv", text);
}

std::string rows_table(const std::vector<Row>& rows) {
  std::string html =
      "<div class=\"scroll\"><table>\n<thead><tr><th>condition</th><th>method</th><th>setting</th><th>error, "
      "largest</th><th>median</th><th>failed</th><th>ns, p50</th><th>p99</th><th>set-up, "
      "µs</th></tr></thead>\n<tbody>\n";
  std::string last;
  for (const Row& row : rows) {
    const std::string condition = row.condition == last ? "" : html_escaped(row.condition);
    last = row.condition;
    const std::string method = html_escaped(row.family);
    html += fmt::format(
        "<tr><th>{}</th><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{:.3g}</td><td>{:.3g}</"
        "td><td>{}</td></tr>\n",
        condition, row.is_default ? "<b>" + method + "</b> (default)" : method, html_escaped(row.setting),
        number(row.errors.largest), number(row.errors.median),
        row.errors.failures > 0 ? fmt::format("{}/{}", row.errors.failures, row.errors.points)
                                : std::string(),
        row.cost.p50_ns, row.cost.p99_ns,
        row.setup_us > 0 ? fmt::format("{:.3g}", row.setup_us) : std::string());
  }
  return html + "</tbody></table></div>\n";
}

Figure work_precision_figure(const Figure& text, const std::vector<Row>& rows, const std::string& error_name,
                             const FigureFolder& folder) {
  std::vector<std::string> panels, families;
  for (const Row& row : rows) {
    panels.push_back(row.condition);
    families.push_back(row.family);
  }
  panels = distinct(panels);
  families = distinct(families);
  // One data file: a block for each panel and family, told apart by gnuplot's index.
  std::string data = "# time_ns,error,default\n";
  std::vector<std::vector<int>> index(panels.size(), std::vector<int>(families.size(), -1));
  int next = 0;
  for (std::size_t p = 0; p < panels.size(); ++p) {
    for (std::size_t f = 0; f < families.size(); ++f) {
      std::string block;
      for (const Row& row : rows) {
        if (row.condition != panels[p] || row.family != families[f] || !std::isfinite(row.errors.largest))
          continue;
        block += fmt::format("{:.5g},{:.5g},{}\n", row.cost.p50_ns, std::max(row.errors.largest, kFloor),
                             row.is_default ? 1 : 0);
      }
      if (block.empty()) continue;
      data += block + "\n\n";
      index[p][f] = next++;
    }
  }
  folder.write(text.id + ".csv", data);
  const auto joined = [&](const std::string& family) {
    const bool knob = std::any_of(rows.begin(), rows.end(),
                                  [&](const Row& row) { return row.family == family && row.is_knob; });
    return knob ? "linespoints" : "points";
  };
  const auto plot_of = [&](const std::string& panel) {
    const std::size_t p =
        static_cast<std::size_t>(std::find(panels.begin(), panels.end(), panel) - panels.begin());
    std::string plot;
    for (std::size_t f = 0; f < families.size(); ++f) {
      if (index[p][f] < 0) continue;
      plot += fmt::format(
          "{}'{}.csv' index {} using 1:2 with {} lc rgb '{}' pt {} ps 0.6 lw 1.2, '' index {} using "
          "($3 == 1 ? $1 : NaN):2 with points lc rgb '{}' pt 6 ps 1.6 lw 1.6",
          plot.empty() ? "plot " : ", \\\n  ", text.id, index[p][f], joined(families[f]),
          kColours[f % kStyles], kPoints[f % kStyles], index[p][f], kColours[f % kStyles]);
    }
    return plot;
  };
  const int height = height_of(panels.size(), families.size());
  Figure figure = text;
  folder.draw(
      figure, 1000, height,
      panel_grid(panels, plot_of, families,
                 {"time of one evaluation (ns, median)", error_name, "set format x '10^{%T}'\n"}, height));
  return figure;
}

Figure log_line_figure(const Figure& text, const std::vector<Line>& lines, const LineAxes& axes,
                       const FigureFolder& folder) {
  std::vector<std::string> panels, names;
  for (const Line& line : lines) {
    panels.push_back(line.panel);
    names.push_back(line.name);
  }
  panels = distinct(panels);
  names = distinct(names);
  std::string data = "# x,y\n";
  for (const Line& line : lines) {
    data += fmt::format("# {}: {}\n", line.panel, line.name);
    for (std::size_t i = 0; i < line.x.size(); ++i) {
      const double y = std::isfinite(line.y[i]) ? std::max(line.y[i], kFloor) : NAN;
      data += fmt::format("{:.6g},{:.6g}\n", line.x[i], y);
    }
    data += "\n\n";
  }
  folder.write(text.id + ".csv", data);
  const auto plot_of = [&](const std::string& panel) {
    std::string plot;
    for (std::size_t i = 0; i < lines.size(); ++i) {
      if (lines[i].panel != panel) continue;
      const std::size_t f =
          static_cast<std::size_t>(std::find(names.begin(), names.end(), lines[i].name) - names.begin());
      plot += fmt::format("{}'{}.csv' index {} using 1:2 with linespoints lc rgb '{}' pt {} ps 0.5 lw 1.4",
                          plot.empty() ? "plot " : ", \\\n  ", text.id, i, kColours[f % kStyles],
                          kPoints[f % kStyles]);
    }
    return plot;
  };
  const int height = height_of(panels.size(), names.size());
  Figure figure = text;
  folder.draw(figure, 1000, height, panel_grid(panels, plot_of, names, axes, height));
  return figure;
}

}  // namespace telenano::studies

#include "tests/studies/report/gnuplot.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace telenano::studies {
std::string style(const std::string& id, int width, int height) {
  return fmt::format(
      "set terminal svg size {},{} dynamic font 'Helvetica,Arial,sans-serif,12' name '{}' background "
      "'#FFFFFF'\n"
      "set output '{}.svg'\n{}",
      width, height, id, id, plot::common_style());
}

AxisUnit readable(std::initializer_list<const std::vector<double>*> all, AxisUnit large, const char* small) {
  double most = 0;
  for (const auto* values : all) {
    for (const double value : *values) most = std::max(most, std::abs(value));
  }
  return most > 0 && most < 0.1 ? AxisUnit{small, large.factor * 1e3} : large;
}

namespace {

std::string source(const std::string& file, const AxisUnit& unit) {
  return fmt::format("'{}' using 1:{}", file,
                     unit.factor == 1 ? std::string("2") : fmt::format("($2*{:g})", unit.factor));
}

}  // namespace

std::string curve(const std::string& file, const char* colour, double width, const std::string& title,
                  const AxisUnit& unit) {
  return fmt::format("{} lc rgb '{}' lw {} title {}", source(file, unit), colour, width, quoted(title));
}

std::string jumps(const std::string& file, const char* colour, const AxisUnit& unit) {
  return fmt::format("{} lc rgb '{}' lw 1.2 dt (6,4) notitle", source(file, unit), colour);
}

std::string y_range(double low, double high) {
  if (!(high - low > 1e-12 * std::max(std::abs(low), std::abs(high)))) high = low + 1;
  const double air = 0.06 * (high - low);
  const double raw_step = (high - low) / 4;
  const double decade = std::pow(10.0, std::floor(std::log10(raw_step)));
  const double mantissa = raw_step / decade;
  const double step = decade * (mantissa < 1.5 ? 1 : mantissa < 3.5 ? 2 : mantissa < 7.5 ? 5 : 10);
  return fmt::format("set yrange [{:.6g}:{:.6g}]\nset ytics {:.6g}\n", low - air, high + air, step);
}

std::string y_range(std::initializer_list<const std::vector<double>*> all, bool with_zero,
                    const AxisUnit& unit) {
  double low = with_zero ? 0.0 : HUGE_VAL;
  double high = with_zero ? 0.0 : -HUGE_VAL;
  for (const auto* values : all) {
    for (const double value : *values) {
      if (!std::isfinite(value)) continue;
      low = std::min(low, value);
      high = std::max(high, value);
    }
  }
  return low > high ? y_range(0, 1) : y_range(low * unit.factor, high * unit.factor);
}

std::string y_range_without_peaks(std::vector<double> values) {
  if (values.empty()) return y_range(0, 1);
  const double most = *std::max_element(values.begin(), values.end());
  const auto rank = values.begin() + static_cast<std::ptrdiff_t>(values.size() * 997 / 1000);
  std::nth_element(values.begin(), rank, values.end());
  return y_range(0, *rank > 0 ? std::min(most, 1.3 * *rank) : most);
}

std::string column_of_panels(const std::vector<Panel>& panels, const ColumnPlace& place,
                             const std::string& title) {
  const double n = static_cast<double>(panels.size());
  const double height = (place.top - place.bottom - place.gap * (n - 1)) / n;
  std::string script = fmt::format("set lmargin at screen {}\nset rmargin at screen {}\nset xrange [{}]\n",
                                   place.left, place.right, place.x_range);
  for (std::size_t i = 0; i < panels.size(); ++i) {
    const double top = place.top - static_cast<double>(i) * (height + place.gap);
    script += fmt::format("set tmargin at screen {:.4f}\nset bmargin at screen {:.4f}\n", top, top - height);
    script += i == 0 && !title.empty()
                  ? fmt::format("set title {} noenhanced offset 0,-0.4 font ',13'\n", quoted(title))
                  : "unset title\n";
    script += i + 1 == panels.size() ? "set format x '%g'\nset xlabel 'time (s)' offset 0,0.3\n"
                                     : "set format x ''\nunset xlabel\n";
    // One curve is named by its axis; several have a legend above the panel, where it hides nothing.
    script += panels[i].curves.size() > 1 ? "set key at graph 1, graph 1.02 bottom right horizontal\n"
                                          : "unset key\n";
    script += place.y_labels
                  ? fmt::format("set format y '%g'\nset ylabel {} offset 0.5,0\n", quoted(panels[i].y_label))
                  : "set format y ''\nunset ylabel\n";
    script += panels[i].settings;
    std::string curves;
    for (const std::string& one : panels[i].curves) curves += (curves.empty() ? "" : ", \\\n  ") + one;
    script += "plot " + curves + "\n";
  }
  return script;
}

std::string contact_shades(const RunData& run) {
  std::string script;
  for (std::size_t i = 0; i < run.contacts.size(); ++i) {
    const auto [from, to] = run.contacts[i];
    script += fmt::format(
        "set object {} rectangle from {:.6g}, graph 0 to {:.6g}, graph 1 behind fc rgb '#FBEFD9' fs solid 1 "
        "noborder\n",
        i + 1, from, std::max(to, from + 1e-3 * run.time_s.back()));
  }
  return script;
}

}  // namespace telenano::studies

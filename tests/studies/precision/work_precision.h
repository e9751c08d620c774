#pragma once

#include <functional>
#include <string>
#include <vector>

#include "tests/studies/report/figure_folder.h"

/// Error against run time: what every part of `telenano-lab precision` gives, and how it is shown.
namespace telenano::studies {

/// How much a run may cost. `quick` is for CI: fewer points and repeats, the same methods.
struct Effort {
  bool quick = false;
  int pick(int few, int many) const noexcept { return quick ? few : many; }
};

/// Time of one evaluation over repeated blocks: what a block takes differs by what else the machine does.
struct Cost {
  double p50_ns = 0;
  double p99_ns = 0;
};
Cost measure(const std::function<void()>& block, std::size_t evaluations_a_block, const Effort& effort);

/// Errors of many points, ordered; non-finite ones count as failures.
struct Errors {
  double largest = 0;
  double p99 = 0;
  double median = 0;
  int failures = 0;
  int points = 0;
};
Errors summarise(std::vector<double> errors);

/// One method at one setting under one condition.
struct Row {
  std::string condition;  ///< panel of the figure, e.g. "lambda = 4.04, deep contact"
  std::string family;     ///< method: a line in the figure
  std::string setting;    ///< of its accuracy knob: a point on that line
  bool is_default = false;
  Errors errors;
  Cost cost;
  double setup_us = 0;  ///< what a change of material or radius costs before the first evaluation
  bool is_knob = true;  ///< settings go from coarse to fine: points that a line may join
};

/// A part of the page.
struct Section {
  std::string id;
  std::string title;
  std::string lead;    ///< what was measured against which oracle
  std::string choice;  ///< which default was chosen, and why
  std::vector<Row> rows;
  std::vector<Figure> figures;
  std::vector<std::string> tables;  ///< further ones, as HTML
};

/// id_rows.csv: every row. (Figures have the names without "_rows".)
void write_rows(const Section& section, const FigureFolder& folder);
/// The rows as an HTML table.
std::string rows_table(const std::vector<Row>& rows);

/// A panel for each condition: largest error over median time, a line for each family, the default ringed.
/// The figure's id names its files.
Figure work_precision_figure(const Figure& text, const std::vector<Row>& rows, const std::string& error_name,
                             const FigureFolder& folder);

/// Lines over a common x: one panel a group, logarithmic on both axes.
struct Line {
  std::string panel;
  std::string name;
  std::vector<double> x;
  std::vector<double> y;
};
struct LineAxes {
  std::string x;
  std::string y;
  std::string settings{};  ///< further gnuplot settings
};
Figure log_line_figure(const Figure& text, const std::vector<Line>& lines, const LineAxes& axes,
                       const FigureFolder& folder);

}  // namespace telenano::studies

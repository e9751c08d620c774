#pragma once

#include <initializer_list>
#include <string>
#include <vector>

#include "telenano/common/plot/gnuplot.h"
#include "tests/studies/report/run_data.h"

/// Pieces of gnuplot scripts that all figures share, so that they look like one family.
namespace telenano::studies {

// One meaning each throughout the report.
using plot::kBlue;    // where: tip or hand; approach
using plot::kGreen;   // force and energy at the tip
using plot::kGrey;    // before control
using plot::kInk;     // the account of the hand's port
using plot::kPale;    // commanded
using plot::kPurple;  // what control does
using plot::kRed;     // force at the hand; retract
using plot::quoted;

/// Terminal, output, fonts, grid.
std::string style(const std::string& id, int width, int height);

/// A unit that keeps the numbers of an axis readable; the CSV files stay in the unit of their head line.
struct AxisUnit {
  const char* name;
  double factor = 1;
};
/// `large`, or the unit a thousand times smaller when the values want it.
AxisUnit readable(std::initializer_list<const std::vector<double>*> all, AxisUnit large, const char* small);

std::string curve(const std::string& file, const char* colour, double width, const std::string& title,
                  const AxisUnit& unit = {""});

/// Jumps, of which only the ends were measured or computed: dashed, and not in the legend.
std::string jumps(const std::string& file, const char* colour, const AxisUnit& unit = {""});

/// A range for an axis that holds all of the values and a little air, with about four tics. `with_zero` where
/// zero means something.
std::string y_range(std::initializer_list<const std::vector<double>*> all, bool with_zero = true,
                    const AxisUnit& unit = {""});
/// From zero to what all but a few in a thousand stay below: for values with rare high peaks.
std::string y_range_without_peaks(std::vector<double> values);
std::string y_range(double low, double high);

/// One panel of a column of panels that share the time axis.
struct Panel {
  std::string y_label;
  std::vector<std::string> curves;
  std::string settings{};
};

/// A column of panels on the canvas; positions as fractions of it.
struct ColumnPlace {
  double left = 0.09;
  double right = 0.98;
  double top = 0.94;
  double bottom = 0.09;
  double gap = 0.05;
  bool y_labels = true;
  std::string x_range = "";  ///< from:to in seconds
};

/// Time axis under the lowest panel, title over the highest.
std::string column_of_panels(const std::vector<Panel>& panels, const ColumnPlace& place,
                             const std::string& title);

/// Shades the times in which the tip touches, behind every panel.
std::string contact_shades(const RunData& run);

}  // namespace telenano::studies

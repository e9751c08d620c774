#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "tests/studies/report/run_data.h"

namespace telenano::studies {

/// A figure of the page: caption and the SVG text, empty when gnuplot could not draw it.
struct Figure {
  std::string id;
  std::string title;
  std::string caption;
  std::string svg;
};

/// Draws figures with gnuplot from CSV files; both the CSV files and the gnuplot scripts stay in `folder`, so
/// that any figure can be drawn again by hand: `cd folder && gnuplot NAME.gp`.
class FigureMaker {
 public:
  explicit FigureMaker(std::filesystem::path folder);

  bool has_gnuplot() const noexcept { return has_gnuplot_; }
  Figure position_and_force(const RunData& run);
  Figure force_distance(const RunData& run);
  Figure energy_and_damper(const RunData& run);
  Figure round_trips(const std::vector<RunData>& runs);
  Figure with_and_without(const RunData& without, const RunData& with);

 private:
  /// Writes `name`.csv with a head line of two columns; returns the file's name.
  std::string write_series(const std::string& name, const char* x_name, const char* y_name,
                           const std::vector<double>& x, const std::vector<double>& y, std::size_t stretches);
  void draw(Figure& figure, int width, int height, const std::string& script);

  std::filesystem::path folder_;
  bool has_gnuplot_ = false;
};

}  // namespace telenano::studies

#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "tests/studies/report/curve_data.h"
#include "tests/studies/report/decimate.h"
#include "tests/studies/report/figure_folder.h"
#include "tests/studies/report/run_data.h"

namespace telenano::studies {

/// Draws the figures of recordings in `folder` (FigureFolder). No line is drawn across a hole in the data.
class FigureMaker {
 public:
  explicit FigureMaker(std::filesystem::path folder);

  bool has_gnuplot() const noexcept { return folder_.has_gnuplot(); }
  Figure position_and_force(const RunData& run);
  Figure force_distance(const RunData& run);
  Figure energy_and_damper(const RunData& run);
  Figure round_trips(const std::vector<RunData>& runs);
  /// Two or three sessions of the same task, on the same axes.
  Figure side_by_side(const std::vector<RunData>& runs);
  Figure force_curve(const CurveData& data);

 private:
  /// Writes `name`.csv, a series over the run's time; returns the file's name.
  std::string write_series(const std::string& name, const RunData& run, const char* y_name,
                           const std::vector<double>& y, std::size_t stretches);
  /// A blank line between pieces lifts the pen.
  std::string write_pieces(const std::string& name, const std::string& head,
                           const std::vector<std::vector<Point>>& pieces);
  void draw(Figure& figure, int width, int height, const std::string& script) const {
    folder_.draw(figure, width, height, script);
  }

  FigureFolder folder_;
};

}  // namespace telenano::studies

#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "telenano/nve_server/fit/curve_file.h"
#include "telenano/nve_server/fit/curve_fit.h"
#include "telenano/nve_server/fit/prepared_curve.h"

namespace telenano::app {

/// What the command line of `telenano-nve fit` asks for.
struct FitOptions {
  std::vector<std::string> curves;
  std::string scene;
  std::string out;
  std::string invols;  // nm/V, "stiff", or empty
  std::optional<double> stiffness_n_m;
  std::string thermal;  // file with the lever's thermal motion
  std::string thermal_lever = "rectangular";
  std::string thermal_band;  // LOW:HIGH, Hz
  double temperature_c = 22;
  std::string reference;  // a curve on something whose stiffness is known
  std::optional<double> reference_n_m;
  double stiffness_error_percent = 0;
  std::optional<double> radius_nm;
  std::optional<double> hamaker_aj;
  fit::ColumnChoice columns;
  std::optional<std::size_t> number;  // of the curve, in files with several
  std::vector<std::string> also;
  bool shift = false;
  std::string residuals;
  std::string plot;
  std::string table;
  std::string map;       // folder for pictures of what was found
  std::string map_grid;  // COLUMNSxROWS
  std::string map_size;  // WIDTHxLENGTH, nm
  int threads = 0;
  bool force = false;
};

/// One file on its way.
struct FittedCurve {
  std::string path;
  std::string name;  // the path, and the curve's number in a file with several
  std::size_t number = 0;
  std::shared_ptr<const std::string> bytes;  // of a file with several
  std::string what;
  std::optional<double> stiffness_n_m;  // as the file has it
  std::vector<std::string> notes;
  fit::PreparedCurve prepared;
  fit::CurveFit fit;
};

}  // namespace telenano::app

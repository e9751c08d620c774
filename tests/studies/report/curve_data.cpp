#include "tests/studies/report/curve_data.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <fstream>

#include "telenano/common/base/error.h"

namespace telenano::studies {
namespace {

std::vector<std::string> fields_of(const std::string& line) {
  std::vector<std::string> fields(1);
  for (const char c : line) {
    if (c == ',') {
      fields.emplace_back();
    } else if (c != '\r') {
      fields.back() += c;
    }
  }
  return fields;
}

/// A jump stands out: much more force in one step than in the steps before and after it.
void find_jumps(CurveWay& way) {
  const std::vector<double>& f = way.force_nn;
  if (f.size() < 4) return;
  const auto [low, high] = std::minmax_element(f.begin(), f.end());
  for (std::size_t i = 1; i + 2 < f.size(); ++i) {
    const double neighbours = std::max(std::abs(f[i] - f[i - 1]), std::abs(f[i + 2] - f[i + 1]));
    const double step = std::abs(f[i + 1] - f[i]);
    if (step > 0.02 * (*high - *low) && step > 5 * neighbours) way.jumps.push_back(i);
  }
}

}  // namespace

CurveData load_curve(const std::filesystem::path& path) {
  CurveData data;
  data.path = path;
  std::ifstream in(path);
  if (!in) throw UserError(path.string() + ": cannot be read");
  std::string line;
  std::getline(in, line);
  const std::vector<std::string> names = fields_of(line);
  const auto column = [&](const char* name) {
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end()) {
      throw UserError(path.string() + ": has no column '" + name +
                      "'; the output of telenano-nve curve is expected");
    }
    return static_cast<std::size_t>(found - names.begin());
  };
  const std::size_t direction = column("direction");
  const std::array numbers{column("base_z_nm"), column("force_nn"), column("work_aj")};
  for (std::size_t row = 2; std::getline(in, line); ++row) {
    const std::string where = path.string() + ":" + std::to_string(row) + ": ";
    const std::vector<std::string> fields = fields_of(line);
    if (fields.size() != names.size())
      throw UserError(where + std::to_string(names.size()) + " fields are expected");
    std::array<double, 3> values{};
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      const std::string& text = fields[numbers[i]];
      char* end = nullptr;
      values[i] = std::strtod(text.c_str(), &end);
      if (text.empty() || *end != '\0' || !std::isfinite(values[i])) {
        throw UserError(where + names[numbers[i]] + " '" + text + "' is not a finite number");
      }
    }
    if (fields[direction] != "approach" && fields[direction] != "retract") {
      throw UserError(where + "direction '" + fields[direction] + "': approach or retract is expected");
    }
    CurveWay& way = fields[direction] == "approach" ? data.approach : data.retract;
    way.base_z_nm.push_back(values[0]);
    way.force_nn.push_back(values[1]);
    data.loop_work_aj = values[2];
  }
  if (data.approach.force_nn.empty() || data.retract.force_nn.empty()) {
    throw UserError(path.string() + ": rows of both directions are expected, approach and retract");
  }
  find_jumps(data.approach);
  find_jumps(data.retract);
  for (const double force : data.retract.force_nn)
    data.pull_off_force_nn = std::max(data.pull_off_force_nn, -force);
  if (!data.approach.jumps.empty()) {
    data.snaps_in = true;
    data.snap_in_base_nm = data.approach.base_z_nm[data.approach.jumps.front()];
  }
  if (!data.retract.jumps.empty()) {
    data.lets_go = true;
    data.pull_off_base_nm = data.retract.base_z_nm[data.retract.jumps.back()];
  }
  return data;
}

}  // namespace telenano::studies

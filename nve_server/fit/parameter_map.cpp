#include "telenano/nve_server/fit/parameter_map.h"

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstdint>

namespace telenano::fit {
namespace {

std::string number(double value) {
  constexpr int kDigits = 12;
  char text[32];
  return {text, std::to_chars(text, text + sizeof text, value, std::chars_format::general, kDigits).ptr};
}

}  // namespace

std::string format_map(const ParameterMap& map, std::size_t& filled) {
  std::vector<double> known;
  for (const double value : map.values)
    if (std::isfinite(value)) known.push_back(value);
  std::sort(known.begin(), known.end());
  const double median = known.empty() ? 0.0 : known[known.size() / 2];
  filled = map.values.size() - known.size();
  std::string bytes = "Gwyddion Simple Field 1.0\n";
  bytes += "XRes = " + std::to_string(map.columns) + "\nYRes = " + std::to_string(map.rows) + "\n";
  bytes += "XReal = " + number(1e-9 * map.width_nm) + "\nYReal = " + number(1e-9 * map.length_nm) + "\n";
  bytes += "XYUnits = m\nZUnits = " + map.unit + "\nTitle = " + map.title + "\n";
  bytes.append(4 - bytes.size() % 4, '\0');
  for (int row = map.rows - 1; row >= 0; --row) {
    for (int column = 0; column < map.columns; ++column) {
      const double value = map.values[static_cast<std::size_t>(row) * static_cast<std::size_t>(map.columns) +
                                      static_cast<std::size_t>(column)];
      const auto bits =
          std::bit_cast<std::uint32_t>(static_cast<float>(std::isfinite(value) ? value : median));
      for (int byte = 0; byte < 4; ++byte) bytes += static_cast<char>((bits >> (8 * byte)) & 0xffu);
    }
  }
  return bytes;
}

}  // namespace telenano::fit

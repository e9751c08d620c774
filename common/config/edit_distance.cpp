#include "telenano/common/config/edit_distance.h"

#include <algorithm>

namespace telenano::config {
namespace {

// "tip_radius_um" -> "tip_radius": a wrong unit changes only what follows the last underscore.
std::string_view without_unit(std::string_view name) {
  return name.substr(0, name.rfind('_'));
}

}  // namespace

std::size_t edit_distance(std::string_view a, std::string_view b) {
  const std::size_t columns = b.size() + 1;
  std::vector<std::size_t> before(columns), above(columns), row(columns);
  for (std::size_t j = 0; j < columns; ++j) above[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    row[0] = i;
    for (std::size_t j = 1; j < columns; ++j) {
      const std::size_t change = a[i - 1] == b[j - 1] ? 0 : 1;
      row[j] = std::min({above[j] + 1, row[j - 1] + 1, above[j - 1] + change});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
        row[j] = std::min(row[j], before[j - 2] + 1);
    }
    std::swap(before, above);
    std::swap(above, row);
  }
  return above[b.size()];
}

std::string nearest_name(std::string_view written, const std::vector<std::string>& names) {
  std::string best;
  std::size_t best_distance = written.size();
  for (const std::string& name : names) {
    std::size_t distance = edit_distance(written, name);
    const std::string_view stem = without_unit(name);
    if (stem.size() > 2 && (without_unit(written) == stem || written == stem))
      distance = std::min<std::size_t>(distance, 1);
    if (distance < best_distance && 3 * distance <= std::max(written.size(), name.size())) {
      best_distance = distance;
      best = name;
    }
  }
  return best;
}

}  // namespace telenano::config

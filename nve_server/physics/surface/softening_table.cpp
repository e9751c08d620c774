#include "telenano/nve_server/physics/surface/softening_table.h"

#include <cmath>

namespace telenano::physics {

SofteningTable::SofteningTable(const SofteningRule& rule) : rule_(rule) {
  pressed_ = side(true);
  gap_ = side(false);
}

std::shared_ptr<const SofteningTable::Pieces> SofteningTable::side(bool pressed) const {
  auto pieces = std::make_shared<Pieces>();
  const double ends[] = {0.0, kFirst, kSecond, kThird};
  for (int part = 0; part < 3; ++part) {
    const double width = (ends[part + 1] - ends[part]) / kCells;
    // Value, and slope and bend over a cell.
    const auto at = [&](int node) {
      const double xi = ends[part] + node * width;
      const SofteningLevel level =
          softening_level(rule_, pressed ? -xi - rule_.pressed_onset_nm : xi + rule_.dead_zone_nm);
      return SofteningLevel{level.level, (pressed ? -width : width) * level.slope_per_nm,
                            width * width * level.bend_per_nm2};
    };
    for (int cell = 0; cell < kCells; ++cell) {
      const SofteningLevel from = at(cell), to = at(cell + 1);
      const double half = 0.5 * from.bend_per_nm2;
      const double rise = to.level - from.level - from.slope_per_nm - half;
      const double turn = to.slope_per_nm - from.slope_per_nm - from.bend_per_nm2;
      const double bend = to.bend_per_nm2 - from.bend_per_nm2;
      pieces->push_back({{from.level, from.slope_per_nm, half, 10.0 * rise - 4.0 * turn + 0.5 * bend,
                          -15.0 * rise + 7.0 * turn - bend, 6.0 * rise - 3.0 * turn + 0.5 * bend}});
    }
  }
  return pieces;
}

}  // namespace telenano::physics

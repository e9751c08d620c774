#pragma once

#include <memory>
#include <vector>

#include "telenano/nve_server/physics/surface/softening.h"

namespace telenano::physics {

/// softening_level() of one rule without its roots, divisions and logarithm: each evaluation of a scan's
/// fields asks for it.
///
/// Method    Over ξ of the rule, on either side of touch, polynomials of fifth order through value, slope and
///           bend of the rule at the ends of their cells. So it is C² as the rule is, and slope and bend are
///           exactly its own derivatives. Cells of 1/128, 1/16 and 1/2 nm; from 73 nm on the rule itself.
/// Errors    Level within 1e-8 of the rule's for tips of 5 nm and more, 1e-6 for 1 nm.
class SofteningTable {
 public:
  SofteningTable() = default;
  explicit SofteningTable(const SofteningRule& rule);

  SofteningLevel level(double v0_nm) const noexcept {
    const bool pressed = v0_nm < 0.0;
    const double xi = pressed ? -v0_nm - rule_.pressed_onset_nm : v0_nm - rule_.dead_zone_nm;
    if (!(xi > 0.0)) return {};
    double at = 0, per_cell = 0;
    if (xi < kFirst) {
      per_cell = kCells / kFirst;
      at = xi * per_cell;
    } else if (xi < kSecond) {
      per_cell = kCells / (kSecond - kFirst);
      at = kCells + (xi - kFirst) * per_cell;
    } else if (xi < kThird) {
      per_cell = kCells / (kThird - kSecond);
      at = 2 * kCells + (xi - kSecond) * per_cell;
    } else {
      return softening_level(rule_, v0_nm);
    }
    const int cell = static_cast<int>(at);
    const double u = at - cell;
    const Piece& c = (*(pressed ? pressed_ : gap_))[static_cast<std::size_t>(cell)];
    const double u2 = u * u;
    SofteningLevel out;
    out.level = (c.a[0] + u * c.a[1]) + u2 * ((c.a[2] + u * c.a[3]) + u2 * (c.a[4] + u * c.a[5]));
    const double slope =
        (c.a[1] + u * (2.0 * c.a[2])) + u2 * ((3.0 * c.a[3] + u * (4.0 * c.a[4])) + u2 * (5.0 * c.a[5]));
    out.slope_per_nm = (pressed ? -per_cell : per_cell) * slope;
    out.bend_per_nm2 = (per_cell * per_cell) *
                       ((2.0 * c.a[2] + u * (6.0 * c.a[3])) + u2 * (12.0 * c.a[4] + u * (20.0 * c.a[5])));
    return out;
  }

 private:
  static constexpr int kCells = 128;  // of each of three widths
  static constexpr double kFirst = 1.0, kSecond = 9.0, kThird = 73.0;
  struct Piece {
    double a[6];
  };
  using Pieces = std::vector<Piece>;
  std::shared_ptr<const Pieces> side(bool pressed) const;

  SofteningRule rule_;
  std::shared_ptr<const Pieces> pressed_, gap_;  // shared by copies
};

}  // namespace telenano::physics

#pragma once

#include <algorithm>

namespace telenano::link {

/// The peer's cumulative energies as known here: each the highest that came within one epoch, Ê = max(Ê,
/// packet). Totals instead of differences, so that loss, duplication and reordering neither lose nor credit
/// energy; and reset with the epoch, so that a restarted peer neither freezes the budget nor is credited
/// twice. Unit as the message's.
class ReceivedEnergy {
 public:
  void reset() noexcept { in_ = out_ = 0; }
  void update(double in, double out) noexcept {
    in_ = std::max(in_, in);
    out_ = std::max(out_, out);
  }
  double in() const noexcept { return in_; }
  double out() const noexcept { return out_; }

 private:
  double in_ = 0;
  double out_ = 0;
};

}  // namespace telenano::link

#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

namespace telenano::link {

/// What a sample holds, and what was paid for it, so that a change of scale makes no energy.
///
/// A scale says how many joules of the hand one joule at the tip stands for: its price. What was pressed into
/// a sample at one price and comes out at another would be worth more, or less, than the hand has paid. So
/// energy is matched, the last in first out, and valued at the worse of its two prices:
///
///   out of what was put in at p, while p' holds:   credited at min(p, p'),
///   into what had been given out at p (a tip that snapped in, and is pulled off now):   charged at max(p,
///   p').
///
/// Any such matching is passive: with each joule credited at no more than it was charged, Σ credits ≤ Σ
/// charges − (value of what is still in) ≤ Σ charges, and where more came out than ever went in, the sample's
/// own well, no more is credited for it than it was worth then. Last in first out is the order of springs:
/// what has been lost in the sample stays at the bottom and is never asked for.
///
/// Energies are ≥ 0 and finite, aJ; prices > 0 and finite in any unit, or 0: not known, and worth nothing. At
/// one price what is returned is the argument itself, to the last bit. Allocates nothing; of more than kLots
/// different prices the oldest two are taken for one, at the worse price.
class PricedEnergy {
 public:
  void reset() noexcept { *this = {}; }

  /// Goes in at `price`. Returns what it costs, counted in aJ at that price.
  double put_in(double energy_aj, double price) noexcept { return move(energy_aj, price, false); }
  /// Comes out at `price`. Returns what may be credited for it, counted in aJ at that price.
  double take_out(double energy_aj, double price) noexcept { return move(energy_aj, price, true); }

  static constexpr std::size_t kLots = 16;

  /// Shows all that it knows to `v`, for writing it down or reading it. False: no such state.
  template <class V, class Self>
  static bool fields(V& v, Self& self) noexcept {
    std::uint64_t count = self.count_;
    v(count);
    v(self.owed_);
    bool good = count <= kLots;
    for (std::size_t i = 0; good && i < count; ++i) {
      v(self.lots_[i].energy_aj);
      v(self.lots_[i].price);
      good = self.lots_[i].energy_aj >= 0 && self.lots_[i].price >= 0;
    }
    if constexpr (V::kReads) self.count_ = good ? count : 0;
    return good;
  }

 private:
  struct Lot {
    double energy_aj = 0;
    double price = 0;
  };

  double move(double energy_aj, double price, bool out) noexcept {
    double correction_aj = 0;
    double left_aj = energy_aj;
    while (left_aj > 0 && count_ > 0 && owed_ != out) {
      Lot& last = lots_[count_ - 1];
      const double part_aj = std::min(left_aj, last.energy_aj);
      const double ratio = price > 0 ? std::min(last.price / price, kRatioMax) : 1;
      correction_aj += part_aj * ((out ? std::min(1.0, ratio) : std::max(1.0, ratio)) - 1);
      left_aj -= part_aj;
      last.energy_aj -= part_aj;
      if (!(last.energy_aj > 0)) --count_;
    }
    if (left_aj > 0) {
      owed_ = out;
      push({left_aj, price});
    }
    return energy_aj + correction_aj;
  }

  void push(const Lot& lot) noexcept {
    if (count_ > 0 && lots_[count_ - 1].price == lot.price) {
      lots_[count_ - 1].energy_aj += lot.energy_aj;
      return;
    }
    if (count_ == kLots) {
      const double price = owed_ ? std::max(lots_[0].price, lots_[1].price)  //
                                 : std::min(lots_[0].price, lots_[1].price);
      lots_[1] = {lots_[0].energy_aj + lots_[1].energy_aj, price};
      std::shift_left(lots_.begin(), lots_.end(), 1);
      --count_;
    }
    lots_[count_++] = lot;
  }

  static constexpr double kRatioMax = 1e15;  // keeps sums finite, whatever a peer says

  std::array<Lot, kLots> lots_{};
  std::size_t count_ = 0;
  bool owed_ = false;  // the lots are what came out beyond all that went in
};

}  // namespace telenano::link

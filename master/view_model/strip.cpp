#include "telenano/master/view_model/strip.h"

#include <algorithm>
#include <cmath>

namespace telenano::view_model {
namespace {

constexpr double kGreatest = 1e30;
constexpr double kGreatestTimeS = 1e12;

}  // namespace

Strip::Strip(double window_s, std::size_t bins)
    : window_s_(window_s), bin_s_(window_s / static_cast<double>(bins)), bins_(bins) {}

void Strip::add(double time_s, double value) noexcept {
  // Beyond what a float holds is no number either; nor is a time whose bins cannot be counted.
  if (!(std::abs(value) <= kGreatest) || !(std::abs(time_s) <= kGreatestTimeS)) return;
  const auto number = static_cast<long long>(std::floor(time_s / bin_s_));
  if (any_ && number < newest_number_) return;
  if (!any_) newest_number_ = number;
  any_ = true;
  const long long ahead = std::min<long long>(number - newest_number_, static_cast<long long>(bins_.size()));
  for (long long i = 0; i < ahead; ++i) {
    newest_ = (newest_ + 1) % bins_.size();
    bins_[newest_] = {};
  }
  newest_number_ = number;
  Bin& bin = bins_[newest_];
  const auto v = static_cast<float>(value);
  bin.least = bin.empty ? v : std::min(bin.least, v);
  bin.greatest = bin.empty ? v : std::max(bin.greatest, v);
  bin.empty = false;
}

bool Strip::range(double& least, double& greatest) const noexcept {
  bool any = false;
  for (const Bin& bin : bins_) {
    if (bin.empty) continue;
    least = any ? std::min<double>(least, bin.least) : bin.least;
    greatest = any ? std::max<double>(greatest, bin.greatest) : bin.greatest;
    any = true;
  }
  return any;
}

}  // namespace telenano::view_model

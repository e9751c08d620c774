#pragma once

#include <cstddef>
#include <vector>

namespace telenano::view_model {

/// What a strip chart shows of one quantity: the last seconds, in bins of equal length that each keep the
/// least and the greatest value, so that no peak of a fast loop is lost however few pixels there are.
class Strip {
 public:
  struct Bin {
    float least = 0;
    float greatest = 0;
    bool empty = true;
  };

  Strip(double window_s, std::size_t bins);

  /// Times rise; one before the newest bin is left out, as are values that are no numbers.
  void add(double time_s, double value) noexcept;

  std::size_t size() const noexcept { return bins_.size(); }
  /// 0 the oldest, size() − 1 the newest.
  const Bin& bin(std::size_t i) const noexcept { return bins_[(newest_ + 1 + i) % bins_.size()]; }
  double window_s() const noexcept { return window_s_; }
  /// Least and greatest of all bins; false when there is none.
  bool range(double& least, double& greatest) const noexcept;

 private:
  double window_s_;
  double bin_s_;
  std::vector<Bin> bins_;
  std::size_t newest_ = 0;
  long long newest_number_ = 0;  // bin number since time 0
  bool any_ = false;
};

}  // namespace telenano::view_model

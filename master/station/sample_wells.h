#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

namespace telenano::station {

/// What samples have given of their own (adhesion, attraction), each by the hash of its scene: once, however often a
/// station goes away and comes back. A sample that is left keeps what it was believed, in joules of the hand at that
/// time; another scale makes no more of it.
///
/// Plain data, nothing allocates.
class SampleWells {
 public:
  /// Scenes that are told apart. What comes after them is believed nothing.
  static constexpr std::size_t kScenes = 64;

  /// The sample of this scene is the one at hand from now on.
  void go_to(std::uint64_t scene_hash) noexcept {
    for (now_ = 0; now_ < count_ && samples_[now_].scene_hash != scene_hash; ++now_) {
    }
    if (now_ < count_ || count_ == kScenes) return;
    samples_[count_++] = {scene_hash, 0, 0};
  }

  /// It has given so much, aJ, beyond what was put in. Kept is the most, of all epochs.
  void give(double aj) noexcept {
    if (now_ < count_) samples_[now_].most_aj = std::max(samples_[now_].most_aj, aj);
  }
  double most_given_aj() const noexcept { return now_ < count_ ? samples_[now_].most_aj : 0; }

  /// Of that this is believed, J at the hand. Kept is the most.
  void believe(double j) noexcept {
    if (now_ < count_) samples_[now_].believed_j = std::max(samples_[now_].believed_j, j);
  }
  /// What is believed of all the other samples together.
  double of_others_j() const noexcept {
    double sum_j = 0;
    for (std::size_t i = 0; i < count_; ++i) sum_j += i == now_ ? 0 : samples_[i].believed_j;
    return sum_j;
  }
  /// Is there an account for the one at hand?
  bool knows() const noexcept { return now_ < count_; }

 private:
  struct Sample {
    std::uint64_t scene_hash = 0;
    double most_aj = 0;
    double believed_j = 0;
  };
  std::array<Sample, kScenes> samples_{};
  std::size_t count_ = 0;
  std::size_t now_ = 0;
};

}  // namespace telenano::station

#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "telenano/common/recording/sample.h"

namespace telenano::view_model {

/// A recorded session at a moving moment: played at any speed, halted, moved about in. What has been passed
/// since the last look is handed out row by row, so that trails and charts are those of a live session.
class Playback {
 public:
  /// So much before the moment is shown again after a leap.
  static constexpr double kBeforeS = 30;
  static constexpr double kSlowest = 0.01;
  static constexpr double kFastest = 50;

  struct Mark {
    double time_s = 0;
    std::string text;
  };

  /// `rows` by rising time, one at least.
  explicit Playback(std::vector<recording::Sample> rows, std::vector<Mark> marks = {});

  double begin_s() const noexcept { return rows_.front().time_s; }
  double end_s() const noexcept { return rows_.back().time_s; }
  double time_s() const noexcept { return time_s_; }
  bool playing() const noexcept { return playing_; }
  double speed() const noexcept { return speed_; }
  const std::vector<Mark>& marks() const noexcept { return marks_; }

  void play(bool on) noexcept;  ///< from the beginning again if it is at its end
  void set_speed(double speed) noexcept;
  void seek(double time_s) noexcept;
  /// To the next mark (`way` > 0) or to the last one before; where there is none, to the end or the
  /// beginning.
  void seek_mark(int way) noexcept;
  /// The mark that was passed last and is not older than two seconds of the recording; null: none.
  const Mark* newest_mark() const noexcept;

  /// So much time has passed for who looks on.
  void advance(double dt_s) noexcept;

  /// What has come since the last call. `anew`: time went back or leapt; what was taken before is void.
  struct Passed {
    bool anew = false;
    std::size_t first = 0;
    std::size_t end = 0;
  };
  Passed take() noexcept;
  const recording::Sample& row(std::size_t i) const noexcept { return rows_[i]; }

 private:
  std::size_t rows_until(double time_s) const noexcept;

  std::vector<recording::Sample> rows_;
  std::vector<Mark> marks_;
  double time_s_ = 0;
  double speed_ = 1;
  bool playing_ = true;
  bool leapt_ = true;
  std::size_t taken_ = 0;
};

}  // namespace telenano::view_model

#pragma once

#include <cstdint>
#include <functional>
#include <mutex>
#include <utility>
#include <vector>

#include "telenano/common/recording/mark_row.h"
#include "telenano/common/surface/height_view.h"

namespace telenano::app {

/// What a recording is told of the sample's marks: the nodes that have changed since it was last asked. It is
/// asked by the recorder's thread, from before there is a station until after it; it looks at the heights
/// without holding up who presses them.
class MarkRows {
 public:
  struct Sample {
    /// Those that there are now; null while there are none.
    std::function<const surface::HeightView*()> heights;
    /// The scene's own, which the recording holds; without heights: a plane.
    std::function<surface::HeightGrid()> scene;
  };
  /// Of one session, for the life of this object. Both functions are called from another thread.
  class Session {
   public:
    Session(MarkRows& rows, Sample sample) : rows_(rows) { rows_.set(std::move(sample)); }
    ~Session() { rows_.set({}); }
    Session(const Session&) = delete;
    Session& operator=(const Session&) = delete;

   private:
    MarkRows& rows_;
  };

  /// Appends to `rows`; their times are whose who asks. Nothing before the first mark.
  void newest(std::vector<recording::MarkRow>& rows);

 private:
  void set(Sample sample);
  bool is_told_of(const surface::HeightGrid& place) const noexcept;
  void tell_of(const surface::HeightView& view, std::vector<recording::MarkRow>& rows);

  std::mutex mutex_;  // of what follows
  Sample sample_;
  const surface::HeightView* seen_ = nullptr;
  std::uint64_t version_ = 0;
  surface::HeightGrid told_;  // where the recording knows the nodes to be; no columns: it has not been told
  std::vector<float> known_;  // their heights, as it knows them
};

}  // namespace telenano::app

#pragma once

#include <imgui.h>

#include <vector>

namespace telenano::viewer {

/// Where words stand in the frame that is being drawn, so that none is written over another. Pixels.
class LabelBoard {
 public:
  void clear() noexcept { taken_.clear(); }
  void take(ImVec2 from, ImVec2 to) { taken_.push_back({from, to}); }
  bool is_free(ImVec2 from, ImVec2 to) const noexcept {
    for (const Box& box : taken_) {
      if (from.x < box.to.x && to.x > box.from.x && from.y < box.to.y && to.y > box.from.y) return false;
    }
    return true;
  }
  /// Takes it if it is free.
  bool take_if_free(ImVec2 from, ImVec2 to) {
    const bool free = is_free(from, to);
    if (free) take(from, to);
    return free;
  }

 private:
  struct Box {
    ImVec2 from;
    ImVec2 to;
  };
  std::vector<Box> taken_;
};

}  // namespace telenano::viewer

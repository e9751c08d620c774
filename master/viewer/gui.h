#pragma once

#include <imgui.h>

#include "telenano/master/viewer/label_board.h"
#include "telenano/master/viewer/palette.h"

namespace telenano::viewer {

/// Dear ImGui with the program's fonts and colours. A context must be current. `scale`: of fonts and
/// distances, 1 on an ordinary screen.
class Gui {
 public:
  explicit Gui(float scale);
  ~Gui();
  Gui(const Gui&) = delete;
  Gui& operator=(const Gui&) = delete;

  ImFont* text() const noexcept { return text_; }
  ImFont* small() const noexcept { return small_; }
  ImFont* large() const noexcept { return large_; }
  /// False: no font with Greek letters was found; names are spelt out.
  bool has_greek() const noexcept { return has_greek_; }
  float scale() const noexcept { return scale_; }
  /// Between two frames.
  void set_scale(float scale);
  /// Of the frame that is being drawn.
  LabelBoard& words() const noexcept { return words_; }

 private:
  void load_fonts();

  ImFont* text_ = nullptr;
  ImFont* small_ = nullptr;
  ImFont* large_ = nullptr;
  mutable LabelBoard words_;
  bool has_greek_ = false;
  float scale_;
};

inline ImVec4 vec4(const palette::Rgb& c, float alpha = 1) {
  return {c.r, c.g, c.b, alpha};
}
inline ImU32 ink(const palette::Rgb& c, float alpha = 1) {
  return ImGui::ColorConvertFloat4ToU32(vec4(c, alpha));
}

}  // namespace telenano::viewer

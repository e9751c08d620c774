#pragma once

#include "telenano/master/viewer/gui.h"

namespace telenano::viewer {

struct SliderState {
  double value = 1;
  double least = 1;  ///< logarithmic: all positive
  double greatest = 10;
  double limit = 0;  ///< beyond it the track is red; 0 = none
  bool changed = false;
  bool let_go = false;  ///< in this frame, after it was held
};

/// A logarithmic slider with its text above and the part beyond the limit drawn as forbidden. What is beyond
/// can be pointed at: the owner decides what becomes of it.
void limited_slider(const Gui& gui, const char* id, const char* text, float wide, SliderState& state);

}  // namespace telenano::viewer

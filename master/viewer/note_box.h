#pragma once

#include <imgui.h>

#include <array>
#include <optional>
#include <vector>

#include "telenano/common/recording/sample.h"
#include "telenano/master/view_model/view_port.h"
#include "telenano/master/viewer/gui.h"

namespace telenano::viewer {

/// A line to write a note into, which belongs to the moment when it was opened.
class NoteBox {
 public:
  void open(const recording::Sample& now);
  void close() noexcept { open_ = false; }
  bool is_open() const noexcept { return open_; }

  /// Within a frame. The note, in the frame in which Enter ends it; an empty line ends it without one. What is
  /// typed from the frame after the box opened is in it, however slowly the window is drawn.
  std::optional<view_model::Note> draw(const Gui& gui);

 private:
  void keep_what_is_early();

  bool open_ = false;
  bool focus_ = false;          // asked for in the frame to come
  bool waits_ = false;          // for the line to have the keyboard
  bool entered_ = false;        // Enter was pressed while it waited
  std::vector<ImWchar> early_;  // typed while it waited
  view_model::Note note_;
};

}  // namespace telenano::viewer

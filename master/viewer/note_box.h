#pragma once

#include <array>
#include <optional>

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

  /// Within a frame. The note, in the frame in which Enter ends it; an empty line ends it without one.
  std::optional<view_model::Note> draw(const Gui& gui);

 private:
  bool open_ = false;
  bool focus_ = false;
  view_model::Note note_;
};

}  // namespace telenano::viewer

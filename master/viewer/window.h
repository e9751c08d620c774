#pragma once

#include "telenano/common/rt/log_histogram.h"
#include "telenano/master/view_model/view_port.h"
#include "telenano/master/viewer/view_hooks.h"
#include "telenano/master/viewer/window_glfw.h"

namespace telenano::viewer {

struct WindowEnd {
  rt::LogHistogram frames;  ///< how long they took, without their waiting
  bool again = false;       ///< a person wants the same session once more
};

/// A window with the viewer in it, in the main thread (GLFW's rule), until the session is over, or until
/// a person closes it where ViewHooks::session_end has something to say. Closing the window asks the loop to
/// end the session. At most 60 frames a second; a frame that is late makes the loop wait for nothing. Throws
/// RunError when no window can be opened.
WindowEnd run_window(const ViewFacts& facts, view_model::Ground ground, view_model::ViewPort& port,
                     const ViewHooks& hooks);

}  // namespace telenano::viewer

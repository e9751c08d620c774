#pragma once

#include "telenano/common/rt/log_histogram.h"
#include "telenano/master/view_model/view_port.h"
#include "telenano/master/viewer/view_hooks.h"

namespace telenano::viewer {

/// Is there a display that a window could be opened on?
bool has_display() noexcept;

/// Opens a window that nobody sees, and closes it: throws RunError, with the reason, where run_window()
/// would. In the main thread.
void try_window();

/// A window with the viewer in it, in the main thread (GLFW's rule), until the session is over, or until
/// a person closes it where ViewHooks::last_words has something to say. Closing the window asks the loop to
/// end the session. At most 60 frames a second; a frame that is late makes the loop wait for nothing. Throws
/// RunError when no window can be opened. Returns how long frames took, without their waiting.
rt::LogHistogram run_window(const ViewFacts& facts, view_model::Ground ground, view_model::ViewPort& port,
                            const ViewHooks& hooks);

}  // namespace telenano::viewer

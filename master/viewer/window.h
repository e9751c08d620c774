#pragma once

#include <functional>
#include <optional>
#include <string>

#include "telenano/common/base/vec3.h"
#include "telenano/common/rt/log_histogram.h"
#include "telenano/master/view_model/view_port.h"
#include "telenano/master/viewer/view_hooks.h"
#include "telenano/master/viewer/viewer.h"
#include "telenano/master/viewer/window_glfw.h"

namespace telenano::viewer {

struct WindowEnd {
  rt::LogHistogram frames;  ///< how long they took, without their waiting
  bool again = false;       ///< a person wants the same session once more
};

/// A window, and what draws in it once it was shown: one for the time before a session and the session, since
/// a driver in software takes long to make its programs. Throws RunError when none can be opened.
struct SessionWindow {
  GlfwWindow window{false};
  std::optional<Viewer> viewer;
};

/// What is shown in a window while its session gets ready, or gets to another sample.
struct WaitingHooks {
  std::function<bool()> over;  ///< nothing is waited for any more
  std::function<std::optional<view_model::Ground>()> changed_ground;
  std::function<view_model::ServerScene()> server_scene;
  std::function<void()> cancel;        ///< a person closes the window; called once
  std::function<void()> sample_drawn;  ///< a picture that has its heights is on the screen; called often
};

/// The sample, as soon as it is here, and `words` about what is waited for. `tip_w_nm`: where the tip begins.
/// In the main thread.
void wait_in_window(SessionWindow& in, const ViewFacts& facts, view_model::Ground ground,
                    view_model::ViewPort& port, const Vec3& tip_w_nm, const std::string& words,
                    const WaitingHooks& hooks);

/// The window with the viewer in it, in the main thread (GLFW's rule), until the session is over, or until
/// a person closes it where ViewHooks::session_end has something to say. Closing the window asks the loop to
/// end the session. At most 60 frames a second; a frame that is late makes the loop wait for nothing.
WindowEnd run_window(SessionWindow& in, const ViewFacts& facts, view_model::Ground ground,
                     view_model::ViewPort& port, const ViewHooks& hooks);

}  // namespace telenano::viewer

#pragma once

#include <functional>

#include "telenano/master/viewer/start_screen.h"

namespace telenano::viewer {

/// What the start screen's window needs from the program. Called in the screen's thread, once a frame.
struct StartHooks {
  std::function<void(const view_model::StartChoice&)>
      look;  ///< ask the server; the answer goes into the facts
  std::function<void(const view_model::StartChoice&)> each;
  std::function<bool()> stop_wanted;
};

/// A window with the start screen, in the main thread, until a person starts a session (true) or closes it.
/// Throws RunError when no window can be opened.
bool run_start_window(StartFacts& facts, view_model::StartChoice& choice, const StartHooks& hooks);

}  // namespace telenano::viewer

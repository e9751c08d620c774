#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "telenano/common/rt/latest_value.h"
#include "telenano/master/device/pointer_device.h"
#include "telenano/master/view_model/ground.h"
#include "telenano/master/view_model/playback.h"
#include "telenano/master/view_model/session_end.h"
#include "telenano/master/viewer/view_facts.h"

namespace telenano::viewer {

/// What a screen needs from the program that runs the session. All are called in the screen's thread.
struct ViewHooks {
  std::function<bool()> session_over;
  /// Asked once the session is over. Without the hook the window always goes.
  std::function<view_model::SessionEnd()> session_end;
  /// The program is to end, so a window that has stayed open goes too.
  std::function<bool()> stop_wanted;
  std::function<RecordingStatus()> recording;
  /// Begins a recording of the session that runs, and says its file; throws where none can be made.
  std::function<std::string()> record;
  /// The surface again when its file has changed; asked about once a second.
  std::function<std::optional<view_model::Ground>()> changed_ground;
  /// What is known of the server's scene by now; asked about once a second.
  std::function<view_model::ServerScene()> server_scene;
  /// A picture that has the sample's heights is on the screen; called often.
  std::function<void()> sample_drawn;
  /// Where the mouse's hand goes; null when another device is the hand.
  rt::LatestValue<device::PointerState>* pointer = nullptr;
  /// A recording in place of a session; the window's own end is its end then. Null: a session.
  view_model::Playback* playback = nullptr;
  std::string picture_prefix = "telenano";  ///< of pictures taken by key: PREFIX-1.png …
};

}  // namespace telenano::viewer

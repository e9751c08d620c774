#pragma once

#include <array>
#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "telenano/common/config/slave_limits_file.h"
#include "telenano/common/link/messages.h"
#include "telenano/common/link/practice_link.h"
#include "telenano/common/recording/recorder.h"
#include "telenano/common/rt/latest_value.h"
#include "telenano/common/surface/height_grid.h"
#include "telenano/master/app/run/real_time_session.h"
#include "telenano/master/device/pointer_device.h"
#include "telenano/master/station/station_config.h"
#include "telenano/master/view_model/server_scene.h"
#include "telenano/master/view_model/session_end.h"
#include "telenano/master/view_model/view_port.h"
#include "telenano/master/view_model/view_request_handler.h"

namespace CLI {
class App;
}

namespace telenano::viewer {
struct ViewHooks;
}

namespace telenano::app {

/// The flags of `run` that are about its picture.
struct ViewOptions {
  bool view = false;
  bool no_view = false;
  bool guide = false;
  std::string surface;
  double tip_radius_nm = 0;  ///< 0: as the scene has it
  double text_size = 1;
  std::string screenshot;
  double at_s = 5;
  std::string screenshot_size = "1280x800";
};
/// Those of them that a recording's picture has too; `at`: what --at counts.
void add_picture_flags(CLI::App& command, ViewOptions& options, const std::string& at);
void add_view_flags(CLI::App& command, ViewOptions& options);

/// A task that a simulated hand can be told to do.
struct SimTask {
  std::string name;
  std::string about;
  Vec3 reach_nm = Vec3::Zero();
  bool free = false;  ///< led by the mouse
};

/// What a session tells its picture before it begins.
struct ViewedSession {
  const station::StationConfig& station;
  const device::DeviceInfo& device;
  const config::SlaveLimits& slave;
  std::uint64_t feature_bits = 0;
  int delay_samples = 0;
  std::vector<std::string> scenes;  ///< that the server has; empty: one only
  std::string server;
  std::string recording;              ///< file; empty: none
  std::vector<SimTask> tasks;         ///< of a simulated hand, by number
  Vec3 device_half_m = Vec3::Zero();  ///< of its box
  double give_up_s = 0;               ///< of silence
  /// The true surface, once it is here: each time that it is another one. Null function: it never comes.
  std::function<std::optional<surface::HeightGrid>()> fetched_ground = nullptr;
  std::function<view_model::ServerScene()> server_scene = nullptr;
  std::optional<link::PracticeLink> practice{};  ///< where the link can be made worse
};

/// The picture of a session: a window, or one photograph without a display; nothing where neither is asked
/// for. Made before the session, so that what is missing is said before a server is asked.
class SessionView {
 public:
  /// `mouse`: the mouse is the hand. Throws UserError for flags that do not go together, a surface that
  /// cannot be read, or a build without viewer; RunError without a display.
  SessionView(const ViewOptions& options, bool mouse);
  ~SessionView();
  SessionView(const SessionView&) = delete;
  SessionView& operator=(const SessionView&) = delete;

  bool wanted() const noexcept { return window_ || photo_; }
  bool has_window() const noexcept { return window_; }
  const rt::LatestValue<device::PointerState>* pointer() const noexcept {
    return window_ ? &pointer_ : nullptr;
  }

  /// What is known of the session before it is ready.
  struct Waiting {
    std::string words;  ///< about what is waited for
    std::string server;
    config::SlaveLimits slave;
    Vec3 tip_w_nm = Vec3::Zero();                                        ///< where it begins
    std::function<std::optional<surface::HeightGrid>()> fetched_ground;  ///< as of ViewedSession
    std::function<view_model::ServerScene()> server_scene;
    std::function<void()> cancel;  ///< a person closes the window
  };
  /// `work`, which may take seconds; what it throws is thrown. With a window it is done in a thread of its own
  /// while the window shows the sample. In the main thread.
  void wait_for(const Waiting& waiting, const std::function<void()>& work);
  /// The loop's side, for RealTimeSession; null when no picture is wanted. Once for each sample.
  view_model::ViewRequestHandler* begin(const ViewedSession& session);
  /// After run(): a person wants the same session once more.
  bool again_wanted() const noexcept { return again_; }
  struct Callbacks {
    std::function<void()> each;                           ///< every now and then, while the session runs
    std::function<view_model::SessionEnd()> session_end;  ///< once it is over; not asked of a photograph
    std::function<bool()> stop_wanted;                    ///< a window that has stayed goes
    std::function<bool()> goes_on;  ///< once it is over: the window stays for another sample of the server
    std::function<const recording::Recorder*()> recorder;  ///< null: there is none
    std::function<std::string()> record;                   ///< begins a recording; its file. Throws UserError
  };
  /// The picture, until the session is over, or the window closed that stayed after it. In the main thread.
  /// `give_way`: the loop has no real-time priority, so drawing has to leave it the processors.
  /// Returns one line about the frames for a person; empty when there is none.
  std::string run(const RealTimeSession& live, bool give_way, const Callbacks& callbacks);

 private:
  struct Parts;
  std::string draw(const viewer::ViewHooks& hooks, const RealTimeSession& live);

  ViewOptions options_;
  bool mouse_ = false;
  bool window_ = false;
  bool photo_ = false;
  bool again_ = false;
  view_model::ViewPort port_;
  rt::LatestValue<device::PointerState> pointer_;
  std::unique_ptr<view_model::ViewRequestHandler> requests_;
  std::unique_ptr<Parts> parts_;
  void note_sample_drawn() noexcept;
  std::chrono::steady_clock::time_point began_ = std::chrono::steady_clock::now();
  std::optional<double> sample_drawn_s_;  ///< after that
};

}  // namespace telenano::app

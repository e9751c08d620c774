#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "telenano/common/surface/gsf.h"
#include "telenano/master/view_model/camera.h"
#include "telenano/master/view_model/first_touch.h"
#include "telenano/master/view_model/ground.h"
#include "telenano/master/view_model/live_session.h"
#include "telenano/master/view_model/pointer_hand.h"
#include "telenano/master/view_model/profile.h"
#include "telenano/master/view_model/region.h"
#include "telenano/master/view_model/session_end.h"
#include "telenano/master/view_model/view_port.h"
#include "telenano/master/viewer/control_panel.h"
#include "telenano/master/viewer/gui.h"
#include "telenano/master/viewer/layout.h"
#include "telenano/master/viewer/note_box.h"
#include "telenano/master/viewer/sample_map.h"
#include "telenano/master/viewer/scene_renderer.h"
#include "telenano/master/viewer/view_facts.h"

namespace telenano::viewer {

/// The whole picture, in whatever is current: a window or a canvas without one. It reads the loop through the
/// port and never waits for it.
class Viewer {
 public:
  /// A context of OpenGL 3.3 must be current, as whenever it is used.
  Viewer(const ViewFacts& facts, view_model::Ground ground, view_model::ViewPort& port, float scale);

  /// Another scan of the same sample, e.g. with new marks.
  void set_ground(view_model::Ground ground);
  /// What is known of its scene by now: what is new in it is said.
  void set_server_scene(const view_model::ServerScene& scene, double time_s);

  /// Shows a recording instead of a session: time passes by draw().
  void play(view_model::Playback& playback) noexcept { playback_ = &playback, panel_.play(playback); }
  /// By key, or by button once the session has ended.
  bool quit_wanted() const noexcept { return quit_; }

  /// Takes what the loop has put into the port since the last time.
  void take_samples();
  /// One frame. `time_s`: of any clock, for what blinks and for the grip of the mouse. Input comes from
  /// ImGui's io, which a window fills and a test may.
  void draw(int width_px, int height_px, double time_s, const RecordingStatus& recording);

  /// Of words and what belongs to them, times that of the screen; as far as the window has room.
  void set_text_size(double times) noexcept;
  double text_size() const noexcept { return text_size_; }

  const view_model::PointerHand& hand() const noexcept { return hand_; }
  const view_model::LiveSession& live() const noexcept { return live_; }
  const view_model::Ground& ground() const noexcept { return ground_; }
  const view_model::Region& region() const noexcept { return region_; }
  const view_model::Camera& overview_camera() const noexcept { return overview_camera_; }
  const view_model::Camera& close_up_camera() const noexcept { return close_up_camera_; }
  /// A button has gone down since the last frame, at this place, be it that it was let go and pressed again
  /// within it: the pointer's way until there is no drag, that from there on is one.
  void note_press(const ImVec2& place) noexcept { pressed_at_ = place; }
  /// As drawn last: stands back where the tip would leave the picture.
  const view_model::Camera& shown_overview_camera() const noexcept { return shown_overview_camera_; }
  /// A recording has begun; asked for since the last call.
  void set_recording(const std::string& file) { facts_.recording = file; }
  /// What is added to the link now; empty: nothing.
  std::string practice_text() const { return panel_.practice_text(); }
  bool take_record_wanted() noexcept { return panel_.take_record_wanted(); }
  /// Asked for since the last call.
  bool take_picture_wanted() noexcept { return panel_.take_picture_wanted(); }
  /// The data of what is seen, asked for by key since the last call: the profile that is measured, else the
  /// force-distance curve.
  bool take_surface_wanted() noexcept { return std::exchange(surface_wanted_, false); }
  /// The sample as it is drawn, with the scene's name; only of a ground that has heights.
  surface::Scan drawn_surface() const;
  bool take_data_wanted() noexcept { return std::exchange(data_wanted_, false); }
  std::string data() const;
  /// The force-distance curve in place of the charts of gap and hand force.
  void show_force_curve(bool on) noexcept { force_curve_shown_ = on; }
  bool force_curve_shown() const noexcept { return force_curve_shown_; }
  /// Lets what follows the tip come to rest, as so many frames would.
  void settle(int frames);
  /// Shown for two seconds, and for longer where it takes longer to read.
  void say(const std::string& text, double time_s);
  void show(Views views) noexcept { views_ = views; }
  /// A person writes a note: letters are no commands.
  bool writes_note() const noexcept { return note_box_.is_open(); }
  /// The session is not there yet, or not at this sample: it and the tip at its start are shown, and `words` in the panel's
  /// place. Keys and buttons that ask for something ask nobody.
  void wait(const std::string& words, const Vec3& tip_w_nm);
  /// Now it is, and these are its facts.
  void begin(const ViewFacts& facts);
  /// The session is over: its last moment stays, with these lines over it.
  void end(view_model::SessionEnd end);
  /// By key or button once the session has ended: the same once more.
  bool again_wanted() const noexcept { return again_; }

 private:
  enum class Drag : std::uint8_t { kNone, kHandInOverview, kHandInCloseUp, kTurn, kShift, kRegion };
  static constexpr double kTrailStep_nm = 0.25;

  void fit_text(int width_px, int height_px);
  void handle_text_keys(double time_s);
  void reset_cameras();
  void follow_tip(double dt_s);
  void handle_keys(double time_s);
  void handle_session_keys(double time_s);
  void handle_scaling_keys();
  void undo_marks(double time_s);
  void tell_undo(double time_s);
  void tell_scene(double time_s);
  void move_hand_by_keys(double nm_per_pixel);
  void take_played(double time_s);
  void handle_mouse(const Layout& layout, double time_s);
  void draw_charts(const Layout& layout, int height_px);
  void draw_help();
  void draw_end();
  void draw_waiting(const Area& panel);
  void draw_guide(const Layout& layout);
  void draw_note(double time_s);
  Vec3 tip_w_nm() const noexcept;
  bool hand_leads_in_box() const noexcept;
  double border_nm() const noexcept;
  bool measure_at_pointer(const Layout& layout);
  void place_text(double time_s, const Area& area);
  void draw_text() const;
  void watch_recording(const RecordingStatus& recording, double time_s);
  /// Of the section, or of the overview, whose ground is the region's.
  SceneState state(bool overview) const;
  const view_model::Ground& overview_ground() const noexcept { return part_ ? *part_ : ground_; }
  void set_region();
  void narrow_region(double time_s);
  void fit_overview_to_ground();
  view_model::Camera fitted_overview(const Area& area) const noexcept;

  ViewFacts facts_;
  view_model::DrawnTip tip_;
  view_model::ViewPort& port_;
  float screen_scale_;
  double text_size_ = 1;
  Gui gui_;
  view_model::Ground ground_;
  view_model::Region region_;
  std::optional<view_model::Ground> part_;  // of the ground, that the overview shows; none: the whole
  SceneRenderer renderer_;
  SampleMap map_;
  view_model::LiveSession live_;
  ControlPanel panel_;
  view_model::PointerHand hand_;
  view_model::Camera overview_camera_;
  view_model::Camera shown_overview_camera_;
  bool overview_chosen_ = false;  // a person has zoomed or shifted it: it stays as it is
  view_model::Camera close_up_camera_;
  double close_up_zoom_ = 1;
  double close_up_half_nm_ = 12;
  bool seen_tip_ = false;
  Views views_ = Views::kBoth;
  Drag drag_ = Drag::kNone;
  std::optional<ImVec2> pressed_at_;  // since the last frame
  bool help_ = false;
  view_model::FirstTouch first_touch_;
  view_model::Measurement measurement_;
  NoteBox note_box_;
  bool guide_ = false;
  std::uint32_t undo_told_ = 0;
  std::uint32_t scene_told_ = 0;
  bool force_curve_shown_ = false;
  bool data_wanted_ = false;
  bool surface_wanted_ = false;
  bool leaves_ = false;  ///< the loop is to be told in this frame
  bool quit_ = false;
  bool again_ = false;
  view_model::Playback* playback_ = nullptr;
  double drawn_s_ = 0;
  double followed_s_ = 0;
  std::string said_;
  double said_until_s_ = -1;
  std::optional<ImVec2> said_at_;  // in this frame
  float said_wide_ = 0;            // where its lines are broken
  bool recording_failed_ = false;
  std::string waiting_;            // for this; empty: the session is there
  view_model::SessionEnd ending_;  // no lines: the session goes on
};

}  // namespace telenano::viewer

#pragma once

#include <cstdint>
#include <optional>
#include <utility>

#include "telenano/master/view_model/live_session.h"
#include "telenano/master/view_model/playback.h"
#include "telenano/master/view_model/view_port.h"
#include "telenano/master/viewer/gui.h"
#include "telenano/master/viewer/layout.h"
#include "telenano/master/viewer/view_facts.h"

namespace telenano::viewer {

/// The panel at the right: stop, state, method, scales, numbers. What a person asks for goes into the queue
/// of requests; what is shown is what the loop says, never what was asked.
class ControlPanel {
 public:
  ControlPanel(const ViewFacts& facts, view_model::ViewPort& port)
      : facts_(facts), port_(port), practice_(facts.practice) {}

  void draw(const Gui& gui, const view_model::LiveSession& live, const RecordingStatus& recording,
            const Area& area);

  /// Its facts have become those of a session.
  void begin() noexcept {
    if (!facts_.practice || !practice_)
      practice_ = facts_.practice;  // else the link is as a person has made it
  }

  /// A recording is shown: there is nobody to ask.
  void play(view_model::Playback& playback) noexcept { playback_ = &playback; }

  /// The session is over and its last moment is shown: likewise, but for closing.
  void end() noexcept { ended_ = true; }
  bool take_close_wanted() noexcept { return std::exchange(close_wanted_, false); }
  /// The mouse's hand is at the border of its box, so far from where it took hold; 0: it is not.
  void tell_border(double reach_nm) noexcept { reach_nm_ = reach_nm; }

  void ask(view_model::ViewRequest::Kind kind);
  void stop() noexcept;
  void quit() noexcept;
  /// With a scaling that is safe under it, if the present one is not.
  void ask_method(control::Method method, const recording::Sample& now);
  /// The present scales times these, as far as is safe.
  void ask_scaling(double velocity_times, double force_times, const recording::Sample& now);
  bool method_offered(control::Method method) const noexcept {
    return facts_.method_offered[static_cast<std::size_t>(method)];
  }

  /// Number `task` of the facts; nothing where it does not fit into the hand's box at the present scale.
  void ask_task(int task, const recording::Sample& now);
  bool task_fits(int task, const recording::Sample& now) const noexcept;
  /// Does the mouse lead the hand now?
  bool mouse_leads() const noexcept;

  /// What is added to the link now, for a person; empty: nothing.
  std::string practice_text() const;
  bool clutch_on_screen() const noexcept { return clutch_; }
  void want_picture() noexcept { picture_wanted_ = true; }
  bool take_picture_wanted() noexcept { return std::exchange(picture_wanted_, false); }
  /// A recording, where there is none yet and one can begin.
  void want_recording() noexcept {
    record_wanted_ = facts_.can_record && facts_.recording.empty() && !ended_;
  }
  bool take_record_wanted() noexcept { return std::exchange(record_wanted_, false); }
  /// The last stroke of marks is taken back, where the server can; else why it was not asked.
  std::string ask_undo(const recording::Sample& now);
  bool take_undo_wanted() noexcept { return std::exchange(undo_wanted_, false); }
  bool take_help_wanted() noexcept { return std::exchange(help_wanted_, false); }

 private:
  void draw_stop(const Gui& gui, const recording::Sample& now, float high);
  void draw_messages(const Gui& gui, const recording::Sample& now, float lines);
  void draw_played(const Gui& gui, const recording::Sample& now);
  void draw_task(const recording::Sample& now);
  void draw_method(const recording::Sample& now);
  void draw_scaling(const Gui& gui, const recording::Sample& now, float region_high);
  void draw_region(const Gui& gui, control::Method method, const control::Scaling& shown, ImVec2 size);
  void draw_tip_rows(const view_model::LiveSession& live) const;
  void draw_numbers(const Gui& gui, const view_model::LiveSession& live) const;
  void draw_number_rows(const view_model::LiveSession& live) const;
  void draw_practice();
  void draw_scenes();
  void draw_foot(const Gui& gui, const view_model::LiveSession& live, const RecordingStatus& recording);

  const ViewFacts& facts_;
  view_model::ViewPort& port_;
  view_model::Playback* playback_ = nullptr;
  std::optional<control::Scaling> dragged_;  // while a slider is held
  double reach_nm_ = 0;
  std::optional<link::PracticeLink> practice_;          // what the link is asked to be
  std::optional<link::PracticeLink> practice_dragged_;  // while a slider of it is held
  bool ended_ = false;
  bool close_wanted_ = false;
  bool clutch_ = false;
  bool picture_wanted_ = false;
  bool help_wanted_ = false;
  bool undo_wanted_ = false;
  bool record_wanted_ = false;
};

}  // namespace telenano::viewer

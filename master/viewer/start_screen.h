#pragma once

#include <optional>
#include <string>
#include <vector>

#include "telenano/master/view_model/start_choice.h"
#include "telenano/master/view_model/start_faults.h"
#include "telenano/master/view_model/start_plan.h"
#include "telenano/master/viewer/gui.h"

namespace telenano::viewer {

/// A hand that could be chosen.
struct OfferedHand {
  std::string device;  ///< as --device takes it
  std::string about;
  std::string why_not;  ///< why it cannot be used and what to do; empty: it can
  bool shows_force = false;
};

struct SeenServer {
  std::string server;
  std::string key;
  std::string scene{};       ///< that it had when it answered last; empty: not known
  std::string identity{};    ///< the station's own key pair, instead of `key`, and
  std::string server_key{};  ///< what the server showed
};

/// What the start screen tells a person.
struct StartFacts {
  std::vector<SeenServer> seen;  ///< newest first
  std::vector<OfferedHand> hands;
  bool looking = false;             ///< a server is being asked
  std::string looking_at;           ///< what is waited for meanwhile; empty: its answer
  std::vector<std::string> scenes;  ///< of the server that has answered last, if it has several
  std::string scenes_of;            ///< that server
  std::optional<view_model::StartPlan> plan;
  std::string trouble;                 ///< why there is no plan; empty: not asked, or there is one
  view_model::StartFaults faults;      ///< of the fields, as far as files and the server's answer show them
  std::vector<std::string> last_text;  ///< of the session before; empty: there was none
  bool last_failed = false;
  std::string command_line;  ///< that does the same
};

/// The screen before a session. Draws with Dear ImGui, whose context must be current; input comes from its
/// io, which a window fills and a test may. Tab, arrows, Space and Enter reach all of it.
class StartScreen {
 public:
  enum class Wish { kNone, kLook, kStart, kClose, kCopy };

  explicit StartScreen(float scale);

  /// One frame, in whatever framebuffer is current. Changes `choice`; says what is to be done.
  Wish draw(int width_px, int height_px, const StartFacts& facts, view_model::StartChoice& choice);

 private:
  Wish draw_choices(const StartFacts& facts, view_model::StartChoice& choice);
  Wish draw_scenes(const StartFacts& facts, view_model::StartChoice& choice);
  void draw_hands(const StartFacts& facts, view_model::StartChoice& choice);
  void draw_plan(const StartFacts& facts, const view_model::StartChoice& choice);
  void draw_end(const StartFacts& facts);
  Wish draw_foot(const StartFacts& facts, const view_model::StartChoice& choice, bool enter);
  Wish draw_keys(view_model::StartChoice& choice);
  void draw_recording(view_model::StartChoice& choice);
  void tell_fault(const std::string& fault) const;
  float label(const char* text) const;

  float screen_scale_;
  Gui gui_;
  view_model::StartFaults faults_;  // of this frame
  float foot_px_ = 110;             // as high as it was in the frame before
  bool first_ = true;
};

}  // namespace telenano::viewer

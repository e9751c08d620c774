#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "telenano/common/base/vec3.h"
#include "telenano/master/view_model/scaling_region.h"
#include "telenano/master/view_model/server_scene.h"
#include "telenano/master/view_model/view_port.h"

namespace telenano::viewer {

/// A task of a simulated hand.
struct TaskOffer {
  std::string name;
  std::string about;
  Vec3 reach_nm = Vec3::Zero();  ///< from the hand's start, by axis
  bool free = false;             ///< the mouse leads the hand
};

/// What does not change while a session runs.
struct ViewFacts {
  std::string scene_name;
  std::vector<std::string> scenes;  ///< that the server has besides; empty: there is one only
  std::string server;
  std::string device_name;
  bool mouse_is_hand = false;
  bool hand_in_box = false;             ///< a hand that is pointed at stays within its box: a SpaceMouse's
  bool shows_force = true;              ///< the device has motors
  bool guide = false;                   ///< a person is led to a first touch
  double hand_half_m = 0.055;           ///< half the edge of the box of the mouse's hand
  Vec3 hand_box_half_m = Vec3::Zero();  ///< of the simulated device, by axis
  double hand_back_s = 0.35;            ///< in which that hand comes back to its middle
  std::string recording;                ///< file; empty: none
  std::string played;                   ///< recording that is shown instead of a session; empty: none
  std::vector<TaskOffer> tasks;  ///< that the hand can be told to do; empty: a person's, or one recording's
  double surface_z_w_nm = 0;
  // The tip never leaves it; infinite: not known.
  Vec3 workspace_min_w_nm = Vec3::Constant(-std::numeric_limits<double>::infinity());
  Vec3 workspace_max_w_nm = Vec3::Constant(std::numeric_limits<double>::infinity());
  std::string surface_doubt;  ///< why the scan that is drawn may be another's; empty: it is the session's
  double give_up_s = 0;       ///< of silence, after which the session ends; 0: not known
  std::optional<link::PracticeLink> practice;  ///< where the link can be made worse: how it begins
  double hand_force_limit_n = 0;               ///< what the station never exceeds
  double energy_bound_j = 0;                   ///< that may ever be extracted
  double text_size = 1;                        ///< of words, times the screen's own
  bool can_undo = false;                       ///< the server takes marks back
  bool can_record = false;                     ///< a recording can begin while the session runs
  double tip_radius_given_nm = 0;              ///< by a person, to be drawn; 0: as the scene has it
  view_model::ServerScene scene{};             ///< as far as it is known before
  view_model::ScalingRegion region{};
  std::array<bool, control::kAllMethods.size()> method_offered{};  ///< by this server
};

/// Of the recording, which goes on in a thread of its own.
struct RecordingStatus {
  std::uint64_t rows = 0;
  bool failed = false;
  std::string failure{};  ///< why, where it has
};

}  // namespace telenano::viewer

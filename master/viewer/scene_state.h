#pragma once

#include <limits>

#include "telenano/common/base/vec3.h"
#include "telenano/common/link/messages.h"
#include "telenano/master/view_model/ground.h"
#include "telenano/master/view_model/server_scene.h"
#include "telenano/master/view_model/trail.h"

namespace telenano::viewer {

/// What is to be seen of the tip and the sample in one frame.
struct SceneState {
  const view_model::Ground& ground;
  const view_model::Trail& trail;
  const view_model::TouchedGround& touched;
  Vec3 tip_pos_w_nm = Vec3::Zero();     ///< apex
  Vec3 target_pos_w_nm = Vec3::Zero();  ///< where the station wants it
  Vec3 force_w_nn = Vec3::Zero();       ///< on the tip
  double force_full_nn = 100;           ///< force at which the cone has its full length
  double deflection_nm = 0;             ///< of the lever, up positive
  double lever_exaggeration = 1;        ///< of that, in the overview
  bool contact = false;
  view_model::DrawnTip tip{20, "", ""};
  // Between these the tip can be led now; infinite: not known.
  Vec3 wall_min_w_nm = Vec3::Constant(-std::numeric_limits<double>::infinity());
  Vec3 wall_max_w_nm = Vec3::Constant(std::numeric_limits<double>::infinity());
  bool part = false;          ///< the ground is a part of the sample: what lies beside it is left out
  link::Particle particle{};  ///< radius 0: none is drawn
};

}  // namespace telenano::viewer

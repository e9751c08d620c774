// Where the pictures look from, and at which part of the sample.
#include "telenano/master/viewer/viewer.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "telenano/common/base/constants.h"

namespace telenano::viewer {
namespace {

constexpr double kCloseUpElevation_deg = 12;
constexpr double kCloseUpLeast_nm = 8;
constexpr double kCloseUpMost_nm = 60;
constexpr double kFollow = 0.12;  // of the way to the wanted height of the close-up, in 1/60 s
constexpr double kFollowHz = 60;
constexpr double kTipInside = 0.8;  // of the overview's half height and width that the tip does not leave

}  // namespace

// After each change of the ground or of the region.
void Viewer::set_region() {
  part_.reset();
  if (region_.box()) part_ = ground_.part(*region_.box());
  renderer_.set_ground(overview_ground());
}

void Viewer::narrow_region(double time_s) {
  const bool was_part = part_.has_value();
  const bool narrower = region_.narrow(ground_, tip_w_nm(), 4 * tip_.radius_nm);
  if (!narrower && !was_part) say("The sample is too small for a region of it", time_s);
  set_region();
  fit_overview_to_ground();
}

void Viewer::fit_overview_to_ground() {
  const double extent = std::max(overview_ground().width_nm(), overview_ground().depth_nm());
  overview_camera_.target_nm = {0, 0, 0.06 * extent};
  overview_camera_.distance_nm = 2.55 * extent;
  overview_camera_.depth_range_nm = 3 * extent;
  overview_chosen_ = false;
}

void Viewer::reset_cameras() {
  if (region_.box()) {
    region_.whole();
    set_region();
  }
  overview_camera_ = {};
  overview_camera_.azimuth_deg = -62;
  overview_camera_.elevation_deg = 32;
  fit_overview_to_ground();
  close_up_camera_ = {};
  close_up_camera_.azimuth_deg = -90;
  close_up_camera_.elevation_deg = kCloseUpElevation_deg;
  close_up_camera_.orthographic = true;
  close_up_camera_.distance_nm = 1000;
  close_up_camera_.depth_range_nm = 1000;
  close_up_zoom_ = 1;
  seen_tip_ = false;
}

// The close-up goes with the tip and shows it and the ground under it, nearer when they are near.
void Viewer::follow_tip(double dt_s) {
  const recording::Sample& now = live_.now();
  const Vec3 tip(now.tip_pos_w_nm[0], now.tip_pos_w_nm[1], now.tip_pos_w_nm[2]);
  const double gap = std::abs(live_.gap_nm());
  double wanted = std::clamp(0.8 * gap + kCloseUpLeast_nm, kCloseUpLeast_nm, kCloseUpMost_nm);
  // A particle that is touched is as large as the tip: both are to be seen.
  const link::Particle particle = state(false).particle;
  if (particle.status == link::ParticleStatus::kPushed || particle.status == link::ParticleStatus::kHeld)
    wanted = std::clamp(2 * particle.radius_nm, wanted, kCloseUpMost_nm);
  // By the time that has passed: where frames are slow a drag would go by another scale.
  const double left = std::pow(1 - kFollow, std::clamp(kFollowHz * dt_s, 1.0, kFollowHz));
  close_up_half_nm_ = seen_tip_ ? wanted + left * (close_up_half_nm_ - wanted) : wanted;
  seen_tip_ = now.reply_sequence != 0;
  close_up_camera_.half_height_nm = close_up_half_nm_ / close_up_zoom_;
  Vec3 middle = tip;
  middle.z() -= 0.5 * std::clamp(live_.gap_nm(), -kCloseUpMost_nm, kCloseUpMost_nm);
  close_up_camera_.target_nm = SceneRenderer::close_up_frame(ground_).scene_nm(middle);
  close_up_camera_.target_nm.z() += 0.12 * close_up_camera_.half_height_nm;
}

// A picture that is higher than wide sees less to the sides: it stands back. So it does for a tip that leaves
// it (a stop withdraws it to the top of the workspace, and heights are drawn taller), unless a person has
// chosen what to look at.
//
// A point at d from the camera's target is seen at u = d·up / ((D − d·back) tan(φ/2)) of half the picture's
// height, D the camera's distance: within ±m for D ≥ d·back + |d·up| / (m tan(φ/2)); likewise to the sides,
// where the picture is aspect times as wide.
view_model::Camera Viewer::fitted_overview(const Area& area) const noexcept {
  view_model::Camera camera = overview_camera_;
  camera.distance_nm /= std::clamp(area.aspect(), 0.2, 1.25);
  const recording::Sample& now = live_.now();
  const Vec3 tip(now.tip_pos_w_nm[0], now.tip_pos_w_nm[1], now.tip_pos_w_nm[2]);
  if (overview_chosen_ || now.reply_sequence == 0 || !is_finite(tip)) return camera;
  constexpr double kMost = 5;  // times as far: what lies farther out is no place of a tip
  const double tangent = std::tan(0.5 * camera.field_of_view_deg * kPi / 180);
  // The apex and what stands on it, with room for the words beside it.
  const Vec3 apex = SceneRenderer::overview_frame(overview_ground()).scene_nm(tip);
  double distance_nm = camera.distance_nm;
  for (const Vec3& point : {apex, Vec3(apex + 2.5 * tip_.radius_nm * Vec3::UnitZ())}) {
    const Vec3 d = point - camera.target_nm;
    const double high = std::abs(d.dot(camera.up())) / (kTipInside * tangent);
    const double wide = std::abs(d.dot(camera.right())) / (kTipInside * tangent * area.aspect());
    distance_nm = std::max(distance_nm, d.dot(camera.direction()) + std::max(high, wide));
  }
  camera.distance_nm = std::min(distance_nm, kMost * camera.distance_nm);
  return camera;
}

void Viewer::settle(int frames) {
  for (int i = 0; i < frames; ++i) follow_tip(1 / kFollowHz);
}

}  // namespace telenano::viewer

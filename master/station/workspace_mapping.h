#pragma once

#include "telenano/common/base/vec3.h"
#include "telenano/common/control/scaling.h"

namespace telenano::station {

/// Hand position to tip target: target = anchor_tip + α_v (hand − anchor_hand), clamped to the slave's
/// workspace. Always computed from the anchor, never accumulated, so it does not drift. Frames H and W have
/// parallel axes.
///
/// Clutch: while released the target stands still; engaging again puts the anchor where hand and target are,
/// so the target never jumps.
class WorkspaceMapping {
 public:
  explicit WorkspaceMapping(const control::Scaling& scaling) noexcept : scaling_(scaling) {}

  /// The tip is here; the target starts here. A box without volume on an axis does not limit that axis.
  void begin(const Vec3& tip_pos_w_nm, const Vec3& min_w_nm, const Vec3& max_w_nm) noexcept {
    target_w_nm_ = tip_pos_w_nm;
    min_w_nm_ = min_w_nm;
    max_w_nm_ = max_w_nm;
    following_ = false;
  }

  void update(bool follow, const Vec3& hand_pos_h_m) noexcept {
    if (follow && !following_) {
      anchor_hand_h_m_ = hand_pos_h_m;
      anchor_tip_w_nm_ = target_w_nm_;
    }
    following_ = follow;
    if (!follow) return;
    target_w_nm_ = anchor_tip_w_nm_ + scaling_.tip_displacement_nm(hand_pos_h_m - anchor_hand_h_m_);
    for (int axis = 0; axis < 3; ++axis) {
      if (!(min_w_nm_[axis] < max_w_nm_[axis])) continue;
      // Not std::clamp: what is no number goes to the lower end.
      double& target_nm = target_w_nm_[axis];
      if (!(target_nm > min_w_nm_[axis])) target_nm = min_w_nm_[axis];
      if (!(target_nm < max_w_nm_[axis])) target_nm = max_w_nm_[axis];
    }
  }

  /// From now on with another scale: hand and target stay where they are.
  void rescale(const control::Scaling& scaling, const Vec3& hand_pos_h_m) noexcept {
    scaling_ = scaling;
    anchor_hand_h_m_ = hand_pos_h_m;
    anchor_tip_w_nm_ = target_w_nm_;
  }

  /// The tip has moved by itself, to here; only while not following.
  void stand_at(const Vec3& tip_pos_w_nm) noexcept {
    if (!following_) target_w_nm_ = tip_pos_w_nm;
  }

  const Vec3& target_w_nm() const noexcept { return target_w_nm_; }

 private:
  control::Scaling scaling_;
  Vec3 target_w_nm_ = Vec3::Zero();
  Vec3 anchor_hand_h_m_ = Vec3::Zero();
  Vec3 anchor_tip_w_nm_ = Vec3::Zero();
  Vec3 min_w_nm_ = Vec3::Zero();
  Vec3 max_w_nm_ = Vec3::Zero();
  bool following_ = false;
};

}  // namespace telenano::station

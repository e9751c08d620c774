#include "telenano/master/device/device_map.h"

#include "telenano/common/base/error.h"

namespace telenano::device {

AxisMap AxisMap::parse(const std::array<std::string, 3>& names, const std::string& source) {
  static constexpr const char* kHand[] = {"x (right)", "y (away)", "z (up)"};
  AxisMap map;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::string& name = names[i];
    const bool good =
        name.size() == 2 && (name[0] == '+' || name[0] == '-') && name[1] >= 'x' && name[1] <= 'z';
    if (!good) {
      throw UserError(source + ": hand axis " + kHand[i] + " is given as \"" + name +
                      "\", expected the device's axis with its sign, e.g. \"+y\"");
    }
    map.axis_[i] = name[1] - 'x';
    map.sign_[i] = name[0] == '+' ? 1.0 : -1.0;
  }
  const Vec3 z_h = map.to_hand(Vec3::UnitZ());
  const Vec3 x_h = map.to_hand(Vec3::UnitX());
  const Vec3 y_h = map.to_hand(Vec3::UnitY());
  const Vec3 cross(x_h.y() * y_h.z() - x_h.z() * y_h.y(), x_h.z() * y_h.x() - x_h.x() * y_h.z(),
                   x_h.x() * y_h.y() - x_h.y() * y_h.x());
  const double determinant = cross.dot(z_h);
  if (determinant == 0)
    throw UserError(source + ": the same device axis is given twice, expected x, y and z once each");
  if (determinant < 0) {
    throw UserError(source +
                    ": this map is a mirror, left would be right; turn the sign of one axis "
                    "(telenano-master calibrate finds them)");
  }
  return map;
}

Vec3 AxisMap::to_hand(const Vec3& device_vec) const noexcept {
  return {sign_[0] * device_vec[axis_[0]], sign_[1] * device_vec[axis_[1]], sign_[2] * device_vec[axis_[2]]};
}

Vec3 AxisMap::to_device(const Vec3& hand_vec) const noexcept {
  Vec3 device_vec = Vec3::Zero();
  for (std::size_t i = 0; i < 3; ++i) device_vec[axis_[i]] = sign_[i] * hand_vec[static_cast<int>(i)];
  return device_vec;
}

std::array<std::string, 3> AxisMap::names() const {
  std::array<std::string, 3> names;
  for (std::size_t i = 0; i < 3; ++i) {
    names[i] = std::string(sign_[i] > 0 ? "+" : "-") + static_cast<char>('x' + axis_[i]);
  }
  return names;
}

}  // namespace telenano::device

#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

namespace telenano::device {

/// SpaceMouse family under the two vendors it has been sold by. The first vendor makes ordinary mice as well,
/// so there the products are listed; a device that says of itself that it is a multi-axis controller (usage
/// page 1, usage 8) counts under either.
inline bool is_puck(std::uint16_t vendor, std::uint16_t product, std::uint16_t usage_page,
                    std::uint16_t usage) noexcept {
  constexpr std::uint16_t kLogitech = 0x046d;
  constexpr std::uint16_t k3Dconnexion = 0x256f;
  constexpr std::array<std::uint16_t, 7> kLogitechProducts = {0xc623, 0xc625, 0xc626, 0xc627,
                                                              0xc628, 0xc629, 0xc62b};
  constexpr std::array<std::uint16_t, 7> k3DconnexionProducts = {0xc635, 0xc62e, 0xc63a, 0xc632,
                                                                 0xc638, 0xc633, 0xc652};
  const auto in = [product](const auto& list) {
    return std::find(list.begin(), list.end(), product) != list.end();
  };
  if (vendor != kLogitech && vendor != k3Dconnexion) return false;
  if (usage_page == 1 && usage == 8) return true;
  if (usage_page != 0 || usage != 0) return false;  // another interface of the same receiver: mouse, keyboard
  return vendor == kLogitech ? in(kLogitechProducts) : in(k3DconnexionProducts);
}

}  // namespace telenano::device

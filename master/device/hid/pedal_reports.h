#pragma once

#include <cstdint>
#include <span>

namespace telenano::device {

/// Which buttons of a foot pedal are pressed, as a mask. Pure. Pedals are sold as keyboards or as joysticks,
/// and no two alike; without their report descriptor this much can be said:
///
///   8 bytes     a keyboard's boot report (modifiers, nothing, six key codes): button i is the i-th letter,
///   key
///               code 4 + i; pedals that type a, b, c are buttons 0, 1, 2
///   otherwise   button 8·n + i is bit i of byte n, for the first four bytes
///
/// Where a report begins with its id, the id's own bits look like buttons that are always pressed: they are
/// simply not to be named in the station file.
std::uint32_t pedal_buttons(std::span<const std::uint8_t> report) noexcept;

}  // namespace telenano::device

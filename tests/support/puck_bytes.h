#pragma once

#include <cstdint>
#include <vector>

/// Reports of the SpaceMouse family, byte for byte, as their published formats have them.
namespace telenano::support {

using Bytes = std::vector<std::uint8_t>;

// SpaceNavigator (046d:c626), SpaceMouse Compact (256f:c635): translation and rotation apart.
inline const Bytes kSplitRight = {0x01, 0x5e, 0x01, 0x00, 0x00, 0x00, 0x00};     // x = 350
inline const Bytes kSplitForwards = {0x01, 0x00, 0x00, 0xa2, 0xfe, 0x00, 0x00};  // y = -350: away
inline const Bytes kSplitLifted = {0x01, 0x00, 0x00, 0x00, 0x00, 0x51, 0xff};    // z = -175: up
inline const Bytes kSplitRest = {0x01, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00};
inline const Bytes kSplitTurned = {0x02, 0x0a, 0x00, 0xf6, 0xff, 0x2c, 0x01};  // 10, -10, 300
inline const Bytes kLeftPressed = {0x03, 0x01, 0x00};
inline const Bytes kRightPressed = {0x03, 0x02, 0x00};
inline const Bytes kBothPressed = {0x03, 0x03, 0x00};
inline const Bytes kNonePressed = {0x03, 0x00, 0x00};
// SpaceMouse Wireless (256f:c62e), Universal Receiver (256f:c652): six axes in one report.
inline const Bytes kCombined = {0x01, 0x5e, 0x01, 0xa2, 0xfe, 0x51, 0xff, 0x0a, 0x00, 0xf6, 0xff, 0x2c, 0x01};
inline const Bytes kCombinedRest = {0x01, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0};
// SpaceMouse Pro (046d:c62b): many buttons, the mask six bytes long. Here: 0, 12 and 26.
inline const Bytes kManyButtons = {0x03, 0x01, 0x10, 0x00, 0x04, 0x00, 0x00};
// Battery level of a wireless one: not ours.
inline const Bytes kBattery = {0x17, 0x5f};

}  // namespace telenano::support

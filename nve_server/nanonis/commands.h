#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>

namespace telenano::nanonis {

/// The commands of the Nanonis TCP interface that an AFM slave needs; all values in SI (m, m/s, s).
enum class CommandId : std::uint8_t {
  kXyPosSet,           ///< x, y, wait: move the tip across, at the speed of kSpeedSet
  kXyPosGet,           ///< newest → x, y
  kSpeedSet,           ///< speed, custom (1) or that of scanning (0)
  kSpeedGet,           ///< → speed, custom
  kStop,               ///< of the motion across
  kOnOffSet,           ///< Z controller on (1), off (0)
  kOnOffGet,           ///< → 1, 0
  kZPosSet,            ///< z: only while the Z controller is off
  kZPosGet,            ///< → z
  kStatusGet,          ///< → ZStatus
  kSetpointSet,        ///< of the Z controller, in the unit of the signal that it regulates
  kSetpointGet,        ///< → set point
  kWithdraw,           ///< wait, time-out in ms (−1: none): controller off, tip to the upper limit
  kWithdrawRateSet,    ///< m/s
  kTipLiftSet,         ///< by which the tip is lifted when the controller is switched off
  kSwitchOffDelaySet,  ///< s
  kLimitsEnabledSet,   ///< 1, 0
  kLimitsSet,          ///< high, low
  kSafeTipOnOffSet,    ///< 1 on, 2 off, 0 keep
  kSafeTipOnOffGet,    ///< → 1, 0
  kSafeTipPropsSet,    ///< recovery, pause, threshold
  kSafeTipPropsGet,    ///< → recovery, pause, threshold
  kSignalNamesGet,     ///< → names
  kSignalValGet,       ///< index, newest → value
  kSignalValsGet,      ///< n, n indices, newest → n, n values
  kSignalCalibrGet,    ///< index → calibration in units a volt, offset in units
  kPiezoRangeGet,      ///< → x, y, z: whole ranges, symmetric about 0
  kAcqPeriodSet,       ///< s: the time over which a signal is averaged
  kAcqPeriodGet,       ///< → s
  kWithdrawRateGet,    ///< → m/s
  kTipLiftGet,         ///< → m
  kSwitchOffDelayGet,  ///< → s
  kLimitsEnabledGet,   ///< → 1, 0
  kLimitsGet,          ///< → high, low
  kSafeTipSignalGet,   ///< → the value of the signal that SafeTip watches; no command tells which it is
};
inline constexpr std::size_t kCommandCount = 35;

/// What ZCtrl.StatusGet returns.
enum class ZStatus : std::uint8_t {
  kOff = 1,
  kOn = 2,
  kHold = 3,
  kSwitchingOff = 4,
  kSafeTip = 5,
  kWithdrawing = 6
};

/// What is in a body, one letter a value: d float64, f float32, i int32, I uint32, H uint16; N an int32
/// count and that many int32; F an int32 count and that many float32; S a string array (int32 total bytes,
/// int32 count, and each int32 length and bytes).
struct Command {
  CommandId id;
  std::string_view name;
  std::string_view arguments;
  std::string_view returns;
};

const std::array<Command, kCommandCount>& commands() noexcept;
const Command& command(CommandId id) noexcept;
/// None if there is no such command here.
const Command* find_command(std::string_view name) noexcept;

}  // namespace telenano::nanonis

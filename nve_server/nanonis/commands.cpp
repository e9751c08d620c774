#include "telenano/nve_server/nanonis/commands.h"

#include <algorithm>

namespace telenano::nanonis {
namespace {

using enum CommandId;

constexpr std::array<Command, kCommandCount> kCommands = {{
    {kXyPosSet, "FolMe.XYPosSet", "ddI", ""},
    {kXyPosGet, "FolMe.XYPosGet", "I", "dd"},
    {kSpeedSet, "FolMe.SpeedSet", "fI", ""},
    {kSpeedGet, "FolMe.SpeedGet", "", "fI"},
    {kStop, "FolMe.Stop", "", ""},
    {kOnOffSet, "ZCtrl.OnOffSet", "I", ""},
    {kOnOffGet, "ZCtrl.OnOffGet", "", "I"},
    {kZPosSet, "ZCtrl.ZPosSet", "f", ""},
    {kZPosGet, "ZCtrl.ZPosGet", "", "f"},
    {kStatusGet, "ZCtrl.StatusGet", "", "H"},
    {kSetpointSet, "ZCtrl.SetpntSet", "f", ""},
    {kSetpointGet, "ZCtrl.SetpntGet", "", "f"},
    {kWithdraw, "ZCtrl.Withdraw", "Ii", ""},
    {kWithdrawRateSet, "ZCtrl.WithdrawRateSet", "f", ""},
    {kTipLiftSet, "ZCtrl.TipLiftSet", "f", ""},
    {kSwitchOffDelaySet, "ZCtrl.SwitchOffDelaySet", "f", ""},
    {kLimitsEnabledSet, "ZCtrl.LimitsEnabledSet", "I", ""},
    {kLimitsSet, "ZCtrl.LimitsSet", "ff", ""},
    {kSafeTipOnOffSet, "SafeTip.OnOffSet", "H", ""},
    {kSafeTipOnOffGet, "SafeTip.OnOffGet", "", "H"},
    {kSafeTipPropsSet, "SafeTip.PropsSet", "HHf", ""},
    {kSafeTipPropsGet, "SafeTip.PropsGet", "", "HHf"},
    {kSignalNamesGet, "Signals.NamesGet", "", "S"},
    {kSignalValGet, "Signals.ValGet", "iI", "f"},
    {kSignalValsGet, "Signals.ValsGet", "NI", "F"},
    {kSignalCalibrGet, "Signals.CalibrGet", "i", "ff"},
    {kPiezoRangeGet, "Piezo.RangeGet", "", "fff"},
    {kAcqPeriodSet, "Util.AcqPeriodSet", "f", ""},
    {kAcqPeriodGet, "Util.AcqPeriodGet", "", "f"},
    {kWithdrawRateGet, "ZCtrl.WithdrawRateGet", "", "f"},
    {kTipLiftGet, "ZCtrl.TipLiftGet", "", "f"},
    {kSwitchOffDelayGet, "ZCtrl.SwitchOffDelayGet", "", "f"},
    {kLimitsEnabledGet, "ZCtrl.LimitsEnabledGet", "", "I"},
    {kLimitsGet, "ZCtrl.LimitsGet", "", "ff"},
    {kSafeTipSignalGet, "SafeTip.SignalGet", "", "f"},
}};

constexpr bool in_order() {
  for (std::size_t i = 0; i < kCommands.size(); ++i) {
    if (static_cast<std::size_t>(kCommands[i].id) != i) return false;
  }
  return true;
}
static_assert(in_order(), "command() looks up by place");

}  // namespace

const std::array<Command, kCommandCount>& commands() noexcept {
  return kCommands;
}

const Command& command(CommandId id) noexcept {
  return kCommands[static_cast<std::size_t>(id)];
}

const Command* find_command(std::string_view name) noexcept {
  const auto found =
      std::find_if(kCommands.begin(), kCommands.end(), [&](const Command& c) { return c.name == name; });
  return found == kCommands.end() ? nullptr : &*found;
}

}  // namespace telenano::nanonis

#include <gtest/gtest.h>

#include "telenano/common/base/random.h"
#include "telenano/master/device/hid/pedal_reports.h"
#include "telenano/master/device/hid/pedalled_device.h"
#include "telenano/master/device/replay_device.h"

namespace telenano::device {
namespace {

using Bytes = std::vector<std::uint8_t>;

TEST(PedalReports, KeyboardsByLetterOthersByBit) {
  EXPECT_EQ(pedal_buttons(Bytes{0, 0, 4, 0, 0, 0, 0, 0}), 1u);            // a
  EXPECT_EQ(pedal_buttons(Bytes{2, 0, 6, 4, 0, 0, 0, 0}), 0b101u);        // shift, c, a
  EXPECT_EQ(pedal_buttons(Bytes{0, 0, 3, 36, 255, 0, 0, 35}), 1u << 31);  // codes that are no button
  EXPECT_EQ(pedal_buttons(Bytes{0, 0, 0, 0, 0, 0, 0, 0}), 0u);
  EXPECT_EQ(pedal_buttons(Bytes{0x05}), 0b101u);
  EXPECT_EQ(pedal_buttons(Bytes{0x01, 0x80, 0x00, 0x40, 0xff}), 1u | 1u << 15 | 1u << 30);
  EXPECT_EQ(pedal_buttons({}), 0u);
  Random random(1);
  for (int k = 0; k < 100'000; ++k) {
    Bytes report(random.below(70));
    for (auto& byte : report) byte = static_cast<std::uint8_t>(random.bits());
    pedal_buttons(report);
  }
}

TEST(PedalledDevice, PedalsCountLikeButtonsAndTheirLossIsAStop) {
  HidNews news;
  rt::LatestValue<HidNews> source;
  const HandTrack still{{{0, Vec3(0, 0, 0.01), 0}, {1, Vec3(0, 0, 0.01), 0}}};
  auto replay = std::make_unique<ReplayDevice>(still);
  replay->start_motion();
  PedalledDevice device(std::move(replay), source, ButtonMap{1u << 2, 1u << 1, 1u << 0});
  const auto say = [&](const Bytes& report) {
    take_pedal_report(report, news);
    source.store(news);
  };
  const auto buttons = [&] {
    DeviceReading reading;
    device.advance(1'000'000);
    device.read(reading);
    EXPECT_EQ(reading.hand_pos_h_m, Vec3(0, 0, 0.01));
    return reading.buttons;
  };
  EXPECT_EQ(buttons(), 0u);
  say({0b110});
  EXPECT_EQ(buttons(), kButtonDeadman | kButtonClutch);
  say({0b001});
  say({0});
  EXPECT_EQ(buttons(), kButtonStop) << "pressed and released between two ticks";
  EXPECT_EQ(buttons(), 0u);
  news.gone = true;
  source.store(news);
  EXPECT_EQ(buttons(), kButtonStop);
  EXPECT_EQ(buttons(), kButtonStop);
  EXPECT_EQ(device.write_force(Vec3(1, 0, 0)), Vec3(1, 0, 0));
}

}  // namespace
}  // namespace telenano::device

// SpaceMice through the kernel: uhid makes a HID device, the kernel a hidraw node of it, hidapi opens that.
// Only where /dev/uhid may be opened: hid_vm.sh brings such a machine along.
#include <gmock/gmock.h>

#include <thread>

#include "telenano/common/base/error.h"
#include "telenano/master/device/hid/hid_port.h"
#include "telenano/master/device/hid/hid_reader.h"
#include "tests/support/puck_bytes.h"
#include "tests/support/virtual_hid.h"
#include "tests/system/programs.h"

namespace telenano::programs {
namespace {

using device::FoundDevice;
using device::HidNews;
using device::HidReader;
using support::VirtualHid;
using ::testing::HasSubstr;

const VirtualHid::Description kCompact{"3Dconnexion SpaceMouse Compact", "", 0x256f, 0xc635,
                                       support::kSplitDescriptor};
const VirtualHid::Description kNavigator{"3Dconnexion SpaceNavigator", "", 0x046d, 0xc626,
                                         support::kSplitDescriptor};
const VirtualHid::Description kReceiver{"", "A1", 0x256f, 0xc652, support::kCombinedDescriptor};
const VirtualHid::Description kReceiverKeyboard{"", "A1", 0x256f, 0xc652, support::kKeyboardDescriptor};
const VirtualHid::Description kOrdinaryMouse{"Ordinary Keyboard", "", 0x046d, 0xc31c,
                                             support::kKeyboardDescriptor};

template <class Condition>
bool soon(const Condition& condition) {
  const auto end = std::chrono::steady_clock::now() + Seconds(10);
  while (std::chrono::steady_clock::now() < end) {
    if (condition()) return true;
    std::this_thread::sleep_for(Milliseconds(1));
  }
  return false;
}

/// Those that can be used; the kernel and its node take a moment.
std::vector<FoundDevice> found(std::size_t count) {
  std::vector<FoundDevice> usable;
  soon([&] {
    usable.clear();
    for (auto& one : device::find_pucks()) {
      if (one.usable) usable.push_back(one);
    }
    return usable.size() == count;
  });
  return usable;
}

class HidrawTest : public ProgramsTest {
 protected:
  void SetUp() override {
    if (!VirtualHid::available())
      GTEST_SKIP()
          << "/dev/uhid cannot be opened here: tests/system/hid_vm.sh runs this in a virtual machine";
    ProgramsTest::SetUp();
  }
};

TEST_F(HidrawTest, SplitReportsByteForByteAndTheLight) {
  for (const auto& what : {kCompact, kNavigator}) {
    SCOPED_TRACE(what.name);
    VirtualHid puck(what);
    ASSERT_TRUE(puck.good());
    const auto usable = found(1);
    ASSERT_EQ(usable.size(), 1u);
    EXPECT_EQ(usable[0].name, what.name);
    EXPECT_THAT(usable[0].node, HasSubstr("/dev/hidraw"));
    std::string description;
    const HidReader reader(device::open_puck({}, description), device::take_puck_report);
    EXPECT_THAT(description, HasSubstr(what.name));
    const auto light = puck.output(2000);
    ASSERT_TRUE(light.has_value());
    EXPECT_EQ(*light, (std::vector<std::uint8_t>{0x04, 0x01}));
    for (const auto& report : {support::kSplitRight, support::kSplitTurned, support::kLeftPressed}) {
      ASSERT_TRUE(puck.send(report));
    }
    EXPECT_TRUE(soon([&] { return reader.news().load().puck.buttons == 1; }));
    EXPECT_EQ(reader.news().load().puck.axes, (std::array<std::int16_t, 6>{350, 0, 0, 10, -10, 300}));
    EXPECT_EQ(reader.news().load().unknown, 0u);
  }
}

TEST_F(HidrawTest, AReceiverWithTwoInterfacesAndNoName) {
  const VirtualHid keyboard(kReceiverKeyboard);
  const VirtualHid other(kOrdinaryMouse);
  VirtualHid puck(kReceiver);
  const auto usable = found(1);
  ASSERT_EQ(usable.size(), 1u) << "its keyboard, or an ordinary one, was taken for a puck";
  EXPECT_EQ(usable[0].serial, "A1");
  std::string description;
  const HidReader reader(device::open_puck({"A1"}, description), device::take_puck_report);
  ASSERT_TRUE(puck.send(support::kCombined));
  EXPECT_TRUE(soon([&] { return reader.news().load().reports == 1; }));
  EXPECT_EQ(reader.news().load().puck.axes, (std::array<std::int16_t, 6>{350, -350, -175, 10, -10, 300}));
  try {
    device::open_puck({"B7"}, description);
    ADD_FAILURE() << "no such serial number";
  } catch (const UserError& error) {
    EXPECT_THAT(error.what(), HasSubstr("attached: A1"));
  }
}

TEST_F(HidrawTest, AFloodLeavesNoBacklogAndUnpluggingIsTold) {
  auto puck = std::make_unique<VirtualHid>(kCompact);
  ASSERT_EQ(found(1).size(), 1u);
  std::string description;
  const HidReader reader(device::open_puck({}, description), device::take_puck_report);
  for (int k = 0; k < 1000; ++k)
    ASSERT_TRUE(puck->send(k % 2 == 0 ? support::kSplitRight : support::kSplitTurned));
  ASSERT_TRUE(puck->send(support::kRightPressed));
  // The kernel keeps 64 reports for a reader and drops what does not fit: the last must get through all the
  // same.
  EXPECT_TRUE(soon([&] {
    puck->send(support::kRightPressed);
    return reader.news().load().puck.buttons == 2;
  }));
  puck.reset();
  EXPECT_TRUE(soon([&] { return reader.news().load().gone; }));
}

TEST_F(HidrawTest, ASessionMovesWhileTheButtonIsHeldAndEndsWhenUnplugged) {
  auto puck = std::make_unique<VirtualHid>(kCompact);
  ASSERT_EQ(found(1).size(), 1u);
  const Finished list = run_program({kMaster, "devices"});
  EXPECT_THAT(list.out, HasSubstr("hid,3Dconnexion SpaceMouse Compact,,/dev/hidraw"));
  Server server(scene_path("flat_silicon_oxide"));
  ChildProcess station({kMaster, "run", "--server", server.address(), "--device", "hid", "--rate", "200"});
  ASSERT_TRUE(station.wait_for_err("engaged", Seconds(1)) || station.wait_for_err("ready", kLong))
      << station.err();
  ASSERT_TRUE(puck->send(support::kLeftPressed));
  for (int k = 0; k < 30; ++k) {
    ASSERT_TRUE(puck->send(support::kSplitRight));
    std::this_thread::sleep_for(Milliseconds(20));
  }
  EXPECT_TRUE(station.wait_for_err("engaged", kLong)) << station.err();
  puck.reset();
  ASSERT_TRUE(station.wait(kLong));
  EXPECT_EQ(station.exit_code(), 1);
  EXPECT_THAT(station.err(), HasSubstr("unplugged"));
}

/// For hid_vm.sh, which looks at its node meanwhile.
TEST_F(HidrawTest, StaysForAWhile) {
  const char* const seconds = std::getenv("TELENANO_HOLD_PUCK_S");
  if (seconds == nullptr) return;
  const VirtualHid puck(kCompact);
  std::this_thread::sleep_for(Seconds(std::atoi(seconds)));
}

}  // namespace
}  // namespace telenano::programs

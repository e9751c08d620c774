// The table of haptic devices, and that every name in it is taken wherever a device is named.
#include "telenano/master/app/devices/device_kinds.h"

#include <gmock/gmock.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <set>
#include <string>

#include "telenano/common/base/error.h"
#include "telenano/common/recording/recorder.h"
#include "telenano/master/app/devices/session_device.h"
#include "telenano/master/app/station_file.h"
#include "telenano/master/station/station.h"
#include "tests/support/standin_drd/standin_sdk.h"

namespace telenano::app {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

template <class Call>
std::string refusal(const Call& call) {
  try {
    call();
  } catch (const std::exception& error) {
    return error.what();
  }
  return "";
}

TEST(DeviceKinds, EveryNameIsTakenAfterTheFlag) {
  std::set<std::string> names;
  for (const DeviceRow& row : kDeviceRows) {
    EXPECT_TRUE(names.insert(row.name).second) << row.name << " stands twice";
    const DeviceSpec spec = parse_device_spec(row.name + std::string(row.reads_file ? ":a b.h5" : ""));
    EXPECT_EQ(spec.kind, row.kind);
    EXPECT_EQ(spec.file, row.reads_file ? "a b.h5" : "");
    // A file too much, or too few.
    EXPECT_THROW(parse_device_spec(row.name + std::string(row.reads_file ? ":" : ":a.h5")), UserError);
  }
  const std::string all = refusal([] { parse_device_spec("omega9"); });
  for (const DeviceRow& row : kDeviceRows) EXPECT_THAT(all, HasSubstr(row.name));
}

TEST(DeviceKinds, TheStationFileTakesEveryNameThatNeedsNoFile) {
  for (const DeviceRow& row : kDeviceRows) {
    const auto parse = [&] {
      return parse_station_file("[device]\nkind = \"" + std::string(row.name) + "\"\n", "s.toml");
    };
    if (row.reads_file) {
      EXPECT_THROW(parse(), UserError) << row.name;
    } else {
      EXPECT_EQ(parse().device.kind, row.name);
    }
  }
}

TEST(DeviceKinds, ThereIsAPlanForThoseThatShowForces) {
  for (const DeviceRow& row : kDeviceRows) {
    const auto info = planned_device({row.kind, "a.h5"}, StationFile{});
    ASSERT_EQ(info.has_value(), row.shows_force) << row.name;
    if (info) {
      EXPECT_EQ(info->name, row.name);
      EXPECT_TRUE(info->has_force);
    }
  }
}

TEST(DeviceKinds, OnlyMotorsCanHome) {
  for (const DeviceRow& row : kDeviceRows) {
    if (row.has_motors) continue;
    EXPECT_THAT(refusal([&] {
                  open_session_device({row.kind, "a.h5"}, {}, true, nullptr);
                }),
                HasSubstr("only --device omega has motors"))
        << row.name;
  }
}

TEST(DeviceKinds, ListsAsHelpAndSentencesSayThem) {
  EXPECT_EQ(choices_text({"a", "b"}), "{a,b}");
  EXPECT_EQ(any_of_text({"a", "b", "c"}), "a, b or c");
  EXPECT_EQ(any_of_text({"a"}), "a");
  EXPECT_EQ(any_of_text({}), "none");
  EXPECT_EQ(choices_text(device_names([](const DeviceRow&) { return true; })),
            "{sim,omega,hid,mouse,replay:FILE}");
}

// Opens each. A device that is not attached to this machine is refused by its own name, not as unknown.
TEST(DeviceKinds, EveryNameIsOpenedAsThatDevice) {
  support::StandinSdk sdk;
  ::setenv("FDSDK", TELENANO_STANDIN_SDK, 1);
  const std::string file = ::testing::TempDir() + "device_kinds_" + std::to_string(::getpid()) + ".h5";
  {
    recording::Recorder recorder({.path = file}, {});
    recording::Sample sample;
    sample.station_mode = static_cast<std::uint32_t>(station::Mode::kEngaged);
    for (int i = 0; i < 3; ++i) {
      sample.time_s = 1e-3 * i;
      ASSERT_TRUE(recorder.push(sample));
    }
  }
  const rt::LatestValue<device::PointerState> pointer;
  for (const DeviceRow& row : kDeviceRows) {
    SCOPED_TRACE(row.name);
    if (row.needs_window) {
      EXPECT_THAT(refusal([&] {
                    open_session_device({row.kind, file}, {}, false, nullptr);
                  }),
                  StartsWith(std::string("--device ") + row.name + ": "));
    }
    SessionDevice opened;
    const std::string why = refusal([&] {
      opened = open_session_device({row.kind, file}, {}, false, &pointer);
    });
    if (row.kind == DeviceKind::kSim) {
      EXPECT_EQ(why, "");  // it is made once the session is known
      EXPECT_EQ(opened.device, nullptr);
    } else if (row.kind == DeviceKind::kHid && opened.device == nullptr) {
      EXPECT_THAT(why, StartsWith("hid: "));
    } else {
      ASSERT_EQ(why, "");
      ASSERT_NE(opened.device, nullptr);
      EXPECT_THAT(opened.device->info().name, StartsWith(row.name));  // an SDK adds its model: omega.3
      EXPECT_TRUE(opened.device->info().has_force || !row.shows_force);
      EXPECT_FALSE(opened.description.empty());
    }
  }
  std::filesystem::remove(file);
}

}  // namespace
}  // namespace telenano::app

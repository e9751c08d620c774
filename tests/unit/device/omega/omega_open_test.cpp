// What can be wrong before a first tick, and what a person is told.
#include <gmock/gmock.h>

#include "telenano/common/base/error.h"
#include "tests/unit/device/omega/omega_rig.h"

namespace telenano::device {
namespace {

using support::DrdCall;
using support::StandinSdk;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

/// What opening says; empty when it works.
template <class Error>
std::string refusal(const OmegaConfig& config, const SdkSearch& search, const UsbRoots& usb) {
  try {
    const OmegaDevice device(config, search, usb);
  } catch (const Error& error) {
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << error.what();
    return error.what();
  }
  return "";
}

TEST(OmegaOpen, NoSdk) {
  const FakeUsb usb;
  SdkSearch search;
  search.loader_names = {"libtelenano_no_such_library.so.3"};
  EXPECT_THAT(
      refusal<UserError>({}, search, usb.roots()),
      AllOf(HasSubstr("SDK not found"), HasSubstr("FDSDK is not set"), HasSubstr("forcedimension.com")));
  search.fdsdk = "/nowhere";
  EXPECT_THAT(refusal<UserError>({}, search, usb.roots()), HasSubstr("FDSDK=/nowhere"));
}

TEST(OmegaOpen, SdkTooOldNamesWhatIsMissing) {
  const FakeUsb usb;
  EXPECT_THAT(refusal<UserError>({}, standin_search("standin_sdk_old"), usb.roots()),
              AllOf(HasSubstr("libdrd.so.2"), HasSubstr("has no dhdGetDeviceCount"), HasSubstr("dhdSetForce"),
                    Not(HasSubstr("dhdOpenID")), HasSubstr("SDK 3.10 or newer")));
}

TEST(OmegaOpen, AFileThatIsNoLibrary) {
  const FakeUsb usb;
  const auto home = std::filesystem::temp_directory_path() / ("telenano_home_" + std::to_string(::getpid()));
  std::filesystem::create_directories(home / ".local/lib");
  std::ofstream(home / ".local/lib/libdrd.so.3") << "no library";
  SdkSearch search;
  search.home = home;
  search.loader_names.clear();
  EXPECT_THAT(refusal<UserError>({}, search, usb.roots()),
              AllOf(HasSubstr(".local/lib/libdrd.so.3 cannot be loaded"), HasSubstr("libusb")));
  std::filesystem::remove_all(home);
}

TEST(OmegaOpen, NothingAttached) {
  const FakeUsb usb;
  StandinSdk sdk;
  sdk->devices = 0;
  EXPECT_THAT(refusal<RunError>({}, standin_search(), usb.roots()),
              AllOf(HasSubstr("no Force Dimension device"), HasSubstr("plug it in")));
}

TEST(OmegaOpen, NoRights) {
  FakeUsb usb;
  usb.attach(5, "1451", "omega.3", false);
  usb.attach(6, "046d", "a mouse", true);
  StandinSdk sdk;
  sdk->devices = 0;
  EXPECT_THAT(refusal<RunError>({}, standin_search(), usb.roots()),
              AllOf(HasSubstr("no permission to open " + usb.node(5)), HasSubstr("udev"),
                    HasSubstr("plug the device in again")));
  sdk->devices = 1;  // some versions of the SDK count it all the same
  sdk->result_of(DrdCall::kOpen) = -1;
  EXPECT_THAT(refusal<RunError>({}, standin_search(), usb.roots()), HasSubstr("no permission to open"));
}

TEST(OmegaOpen, Busy) {
  FakeUsb usb;
  usb.attach(5, "1451", "omega.3", true);
  usb.hold(5, 4242, "HapticDesk");
  StandinSdk sdk;
  sdk->result_of(DrdCall::kOpen) = -1;
  EXPECT_THAT(refusal<RunError>({}, standin_search(), usb.roots()),
              AllOf(HasSubstr("busy: HapticDesk (4242)"), HasSubstr(usb.node(5))));
}

TEST(OmegaOpen, RefusedForAnotherReasonSaysWhatTheSdkSays) {
  FakeUsb usb;
  usb.attach(5, "1451", "omega.3", true);
  StandinSdk sdk;
  sdk->result_of(DrdCall::kOpen) = -1;
  EXPECT_THAT(refusal<RunError>({}, standin_search(), usb.roots()),
              AllOf(HasSubstr("scripted error"), HasSubstr("switch the device off and on")));
}

TEST(OmegaOpen, SerialNumberChoosesAndAWrongOneListsWhatIsThere) {
  const FakeUsb usb;
  StandinSdk sdk;
  sdk->devices = 3;
  OmegaConfig config;
  config.serial = 4713;
  {
    const OmegaDevice device(config, standin_search(), usb.roots());
    EXPECT_THAT(device.description(), HasSubstr("omega.3, serial number 4713, SDK 3.17.6.0"));
    EXPECT_EQ(sdk->open, 1);
  }
  EXPECT_EQ(sdk->open, 0);
  config.serial = 1;
  EXPECT_THAT(refusal<UserError>(config, standin_search(), usb.roots()),
              AllOf(HasSubstr("no device with serial number 1"), HasSubstr("4711, 4712, 4713")));
  EXPECT_EQ(sdk->open, 0);
}

TEST(OmegaOpen, NoPowerOrAnErrorOfTheDevice) {
  const FakeUsb usb;
  StandinSdk sdk;
  sdk->power = 0;
  EXPECT_THAT(refusal<RunError>({}, standin_search(), usb.roots()), HasSubstr("no power"));
  sdk->power = 1;
  sdk->error = 1;
  EXPECT_THAT(refusal<RunError>({}, standin_search(), usb.roots()), HasSubstr("reports an error"));
  sdk->error = 0;
  sdk->result_of(DrdCall::kGetStatus) = -1;
  EXPECT_THAT(refusal<RunError>({}, standin_search(), usb.roots()), HasSubstr("does not tell its state"));
  sdk->result_of(DrdCall::kGetStatus) = 0;
  sdk->result_of(DrdCall::kSetForce) = -1;
  EXPECT_THAT(refusal<RunError>({}, standin_search(), usb.roots()), HasSubstr("zero force was refused"));
  EXPECT_EQ(sdk->open, 0) << "what was opened must be closed again";
}

TEST(OmegaOpen, WithoutAWatchdogOnlyWhenToldSo) {
  const FakeUsb usb;
  StandinSdk sdk;
  sdk->refuse_watchdog = 1;
  EXPECT_THAT(refusal<RunError>({}, standin_search(), usb.roots()),
              AllOf(HasSubstr("watchdog"), HasSubstr("device.watchdog_ms = 0")));
  OmegaConfig config;
  config.watchdog_ms = 0;
  const OmegaDevice device(config, standin_search(), usb.roots());
  ASSERT_EQ(device.notes().size(), 1u);
  EXPECT_THAT(device.notes()[0], HasSubstr("leaves its last force on"));
  config.watchdog_ms = 32;
  EXPECT_THAT(refusal<UserError>(config, standin_search(), usb.roots()), HasSubstr("expected 0 to 31"));
}

TEST(OmegaOpen, OnlyAPersonLetsTheMotorsMoveIt) {
  const FakeUsb usb;
  StandinSdk sdk;
  sdk->calibrated = 0;
  {
    const OmegaDevice device({}, standin_search(), usb.roots());
    EXPECT_EQ(sdk->auto_inits, 0);
    ASSERT_EQ(device.notes().size(), 1u);
    EXPECT_THAT(device.notes()[0], HasSubstr("--home"));
  }
  OmegaConfig config;
  config.home = true;
  {
    const OmegaDevice device(config, standin_search(), usb.roots());
    EXPECT_EQ(sdk->auto_inits, 1);
    EXPECT_TRUE(device.notes().empty());
  }
  {
    const OmegaDevice device(config, standin_search(), usb.roots());  // calibrated: not moved again
    EXPECT_EQ(sdk->auto_inits, 1);
  }
  sdk->calibrated = 0;
  sdk->refuse_auto_init = 1;
  EXPECT_THAT(refusal<RunError>(config, standin_search(), usb.roots()), HasSubstr("homing failed"));
  EXPECT_THAT(refusal<UserError>(config, standin_search("standin_sdk_dhd"), usb.roots()),
              HasSubstr("cannot home"));
  EXPECT_EQ(sdk->open, 0);
}

TEST(OmegaOpen, ListSaysWhatIsThereAndWhyNot) {
  FakeUsb usb;
  StandinSdk sdk;
  usb.attach(5, "1451", "omega.3", true);
  std::vector<FoundDevice> found = find_omegas(standin_search(), usb.roots());
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found[0].name, "omega.3");
  EXPECT_EQ(found[0].serial, "4711");
  EXPECT_EQ(found[0].node, usb.node(5));
  EXPECT_TRUE(found[0].usable);
  EXPECT_EQ(found[0].why, "");
  EXPECT_EQ(sdk->open, 0);

  sdk->force_off_cause = 2;
  EXPECT_THAT(find_omegas(standin_search(), usb.roots())[0].why, HasSubstr("moved too fast"));
  sdk->calibrated = 0;
  EXPECT_THAT(find_omegas(standin_search(), usb.roots())[0].why, HasSubstr("not calibrated"));
  sdk->power = 0;
  found = find_omegas(standin_search(), usb.roots());
  EXPECT_FALSE(found[0].usable);
  EXPECT_THAT(found[0].why, HasSubstr("no power"));
  sdk->result_of(DrdCall::kOpen) = -1;
  usb.hold(5, 4242, "HapticDesk");
  EXPECT_THAT(find_omegas(standin_search(), usb.roots())[0].why, HasSubstr("busy: HapticDesk (4242)"));

  SdkSearch nothing;
  nothing.loader_names.clear();
  found = find_omegas(nothing, usb.roots());
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found[0].node, usb.node(5));
  EXPECT_THAT(found[0].why, HasSubstr("SDK not found"));
}

}  // namespace
}  // namespace telenano::device

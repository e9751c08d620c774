// Takes hidapi_port.cpp's place in a build without HID.
#include "telenano/common/base/error.h"
#include "telenano/master/device/hid/hid_port.h"

namespace telenano::device {
namespace {

constexpr const char* kWithout =
    "this build has no HID devices: install libhidapi-dev and configure with -DTELENANO_HID=ON";

}  // namespace

std::unique_ptr<HidPort> open_puck(const HidChoice&, std::string&) {
  throw UserError(std::string("hid: ") + kWithout);
}

std::unique_ptr<HidPort> open_pedals(std::uint16_t, std::uint16_t, std::string&) {
  throw UserError(std::string("pedal: ") + kWithout);
}

std::vector<FoundDevice> find_pucks() {
  return {{"hid", "", "", "", false, kWithout}};
}

}  // namespace telenano::device

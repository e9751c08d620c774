#include <errno.h>
#include <fcntl.h>
#include <hidapi.h>
#include <unistd.h>

#include <array>
#include <cstring>
#include <set>
#include <utility>

#include "telenano/common/base/error.h"
#include "telenano/master/device/hid/hid_port.h"
#include "telenano/master/device/hid/hid_products.h"

namespace telenano::device {
namespace {

constexpr const char* kNone =
    "no SpaceMouse found (USB or Bluetooth, vendors 046d and 256f): plug it or its receiver in";

/// hidapi's texts are wide; all that is needed of them is ASCII.
std::string narrow(const wchar_t* text) {
  std::string result;
  for (; text != nullptr && *text != L'\0'; ++text) result += *text < 128 ? static_cast<char>(*text) : '?';
  return result;
}

struct Node {
  std::string path;
  std::string name;
  std::string serial;
};

bool puck(const hid_device_info& info) {
  return is_puck(info.vendor_id, info.product_id, info.usage_page, info.usage);
}

/// Nodes that are `wanted`, each once: the library lists a node once for every usage it has.
template <class Wanted>
std::vector<Node> nodes(const char* kind, const Wanted& wanted) {
  std::vector<Node> list;
  std::set<std::string> seen;
  hid_device_info* const all = hid_enumerate(0, 0);
  for (const hid_device_info* it = all; it != nullptr; it = it->next) {
    if (it->path == nullptr || !wanted(*it)) continue;
    if (!seen.insert(it->path).second) continue;
    std::array<char, 32> id{};
    std::snprintf(id.data(), id.size(), "%s %04x:%04x", kind, it->vendor_id, it->product_id);
    const std::string product = narrow(it->product_string);  // empty on some receivers
    list.push_back({it->path, product.empty() ? id.data() : product, narrow(it->serial_number)});
  }
  hid_free_enumeration(all);
  return list;
}

std::string why_not(const Node& node) {
  const int fd = ::open(node.path.c_str(), O_RDWR | O_CLOEXEC | O_NONBLOCK);
  const int error = fd < 0 ? errno : 0;
  if (fd >= 0) ::close(fd);
  if (error == EACCES || error == EPERM) {
    return "no permission to open " + node.path +
           ": copy deploy/udev/70-telenano-haptic.rules to /etc/udev/rules.d, run udevadm control --reload, "
           "plug the "
           "device in again";
  }
  return "cannot open " + node.path + ": " + (error != 0 ? std::strerror(error) : narrow(hid_error(nullptr)));
}

class HidapiPort final : public HidPort {
 public:
  HidapiPort(hid_device* device, bool has_light) noexcept : device_(device), has_light_(has_light) {
    light(1);
  }
  ~HidapiPort() override {
    light(0);
    hid_close(device_);
  }
  HidapiPort(const HidapiPort&) = delete;
  HidapiPort& operator=(const HidapiPort&) = delete;

  int read(std::span<std::uint8_t> report, int timeout_ms) noexcept override {
    return hid_read_timeout(device_, report.data(), report.size(), timeout_ms);
  }

 private:
  /// The ring around the puck says that somebody listens. Not every product has one: no error.
  void light(std::uint8_t on) noexcept {
    if (!has_light_) return;
    const std::array<std::uint8_t, 2> report = {0x04, on};
    hid_write(device_, report.data(), report.size());
  }

  hid_device* device_;
  bool has_light_;
};

}  // namespace

std::unique_ptr<HidPort> open_puck(const HidChoice& choice, std::string& description) {
  hid_init();
  std::string others;
  std::string why;
  for (const Node& node : nodes("SpaceMouse", puck)) {
    if (choice.serial && node.serial != *choice.serial) {
      others += (others.empty() ? "" : ", ") + (node.serial.empty() ? "(none)" : node.serial);
      continue;
    }
    hid_device* const device = hid_open_path(node.path.c_str());
    if (device == nullptr) {
      why = why_not(node);
      continue;
    }
    description =
        node.name + (node.serial.empty() ? "" : ", serial number " + node.serial) + " at " + node.path;
    return std::make_unique<HidapiPort>(device, true);
  }
  if (!why.empty()) throw RunError("hid: " + why);
  if (!others.empty()) {
    throw UserError("hid: no SpaceMouse with serial number " + *choice.serial +
                    " (device.serial); attached: " + others);
  }
  throw RunError(std::string("hid: ") + kNone);
}

std::unique_ptr<HidPort> open_pedals(std::uint16_t vendor, std::uint16_t product, std::string& description) {
  hid_init();
  std::string why;
  for (const Node& node : nodes("pedals", [&](const hid_device_info& info) {
         return info.vendor_id == vendor && info.product_id == product;
       })) {
    hid_device* const device = hid_open_path(node.path.c_str());
    if (device != nullptr) {
      description = node.name + " at " + node.path;
      return std::make_unique<HidapiPort>(device, false);
    }
    why = why_not(node);
  }
  if (!why.empty()) throw RunError("pedal: " + why);
  std::array<char, 96> text{};
  std::snprintf(text.data(), text.size(),
                "pedal: no HID device %04x:%04x (pedal.vendor, pedal.product); plug it in", vendor, product);
  throw RunError(text.data());
}

std::vector<FoundDevice> find_pucks() {
  hid_init();
  std::vector<FoundDevice> found;
  for (const Node& node : nodes("SpaceMouse", puck)) {
    FoundDevice one{"hid", node.name, node.serial, node.path, true, ""};
    hid_device* const device = hid_open_path(node.path.c_str());
    if (device != nullptr) {
      hid_close(device);
    } else {
      one.usable = false;
      one.why = why_not(node);
    }
    found.push_back(std::move(one));
  }
  if (found.empty()) found.push_back({"hid", "", "", "", false, kNone});
  return found;
}

}  // namespace telenano::device

#pragma once

#include <fcntl.h>
#include <linux/uhid.h>
#include <poll.h>
#include <unistd.h>

#include <cstdint>
#include <cstring>
#include <optional>
#include <string>
#include <vector>

namespace telenano::support {

/// A HID device that the kernel takes for a real one (/dev/uhid): it gets a hidraw node, and whatever opens
/// that reads the reports sent here. Unplugged when the object goes.
class VirtualHid {
 public:
  struct Description {
    std::string name;
    std::string serial;
    std::uint16_t vendor = 0;
    std::uint16_t product = 0;
    std::vector<std::uint8_t> report_descriptor;
  };

  static bool available() { return ::access("/dev/uhid", R_OK | W_OK) == 0; }

  explicit VirtualHid(const Description& what) : fd_(::open("/dev/uhid", O_RDWR | O_CLOEXEC)) {
    uhid_event event{};
    event.type = UHID_CREATE2;
    uhid_create2_req& request = event.u.create2;
    std::memcpy(request.name, what.name.data(), what.name.size());
    std::memcpy(request.uniq, what.serial.data(), what.serial.size());
    request.bus = 3;  // BUS_USB
    request.vendor = what.vendor;
    request.product = what.product;
    request.rd_size = static_cast<std::uint16_t>(what.report_descriptor.size());
    std::memcpy(request.rd_data, what.report_descriptor.data(), what.report_descriptor.size());
    good_ = fd_ >= 0 && ::write(fd_, &event, sizeof event) == static_cast<ssize_t>(sizeof event);
  }
  ~VirtualHid() {
    if (fd_ >= 0) ::close(fd_);
  }
  VirtualHid(const VirtualHid&) = delete;
  VirtualHid& operator=(const VirtualHid&) = delete;

  bool good() const { return good_; }

  bool send(const std::vector<std::uint8_t>& report) {
    uhid_event event{};
    event.type = UHID_INPUT2;
    event.u.input2.size = static_cast<std::uint16_t>(report.size());
    std::memcpy(event.u.input2.data, report.data(), report.size());
    return ::write(fd_, &event, sizeof event) == static_cast<ssize_t>(sizeof event);
  }

  /// The next output report that a program writes to it; none within `timeout_ms`.
  std::optional<std::vector<std::uint8_t>> output(int timeout_ms) {
    for (;;) {
      pollfd waited{fd_, POLLIN, 0};
      if (::poll(&waited, 1, timeout_ms) <= 0) return std::nullopt;
      uhid_event event{};
      if (::read(fd_, &event, sizeof event) <= 0) return std::nullopt;
      if (event.type == UHID_OUTPUT)
        return std::vector<std::uint8_t>(event.u.output.data, event.u.output.data + event.u.output.size);
    }
  }

 private:
  int fd_;
  bool good_ = false;
};

/// What a wired SpaceMouse says of its reports: 1 and 2 three axes each, 3 two buttons, 4 the light.
inline const std::vector<std::uint8_t> kSplitDescriptor = {
    0x05, 0x01, 0x09, 0x08, 0xa1, 0x01,                          // generic desktop, multi-axis controller
    0xa1, 0x00, 0x85, 0x01, 0x16, 0xa2, 0xfe, 0x26, 0x5e, 0x01,  // report 1: -350 to 350
    0x36, 0x88, 0xfa, 0x46, 0x78, 0x05, 0x55, 0x0c, 0x65, 0x11,  // -1400 to 1400, 1e-4 cm
    0x09, 0x30, 0x09, 0x31, 0x09, 0x32, 0x75, 0x10, 0x95, 0x03, 0x81, 0x06,  // x y z, 16 bits
    0xc0, 0xa1, 0x00, 0x85, 0x02,                                            // report 2
    0x09, 0x33, 0x09, 0x34, 0x09, 0x35, 0x75, 0x10, 0x95, 0x03, 0x81, 0x06,  // rx ry rz
    0xc0, 0xa1, 0x02, 0x85, 0x03, 0x05, 0x09, 0x19, 0x01, 0x29, 0x02,        // report 3: two buttons
    0x15, 0x00, 0x25, 0x01, 0x35, 0x00, 0x45, 0x01, 0x75, 0x01, 0x95, 0x02, 0x81, 0x02, 0x95, 0x0e, 0x81,
    0x03, 0xc0, 0xa1, 0x02, 0x85, 0x04, 0x05, 0x08, 0x09, 0x4b, 0x15, 0x00, 0x25, 0x01,  // report 4: a
                                                                                         // light
    0x95, 0x01, 0x75, 0x01, 0x91, 0x02, 0x95, 0x01, 0x75, 0x07, 0x91, 0x03, 0xc0, 0xc0};

/// A wireless one: report 1 has six axes.
inline const std::vector<std::uint8_t> kCombinedDescriptor = {
    0x05, 0x01, 0x09, 0x08, 0xa1, 0x01, 0xa1, 0x00, 0x85, 0x01, 0x16, 0xa2, 0xfe, 0x26, 0x5e,
    0x01, 0x36, 0x88, 0xfa, 0x46, 0x78, 0x05, 0x55, 0x0c, 0x65, 0x11, 0x09, 0x30, 0x09, 0x31,
    0x09, 0x32, 0x09, 0x33, 0x09, 0x34, 0x09, 0x35, 0x75, 0x10, 0x95, 0x06, 0x81, 0x06, 0xc0,
    0xa1, 0x02, 0x85, 0x03, 0x05, 0x09, 0x19, 0x01, 0x29, 0x02, 0x15, 0x00, 0x25, 0x01, 0x35,
    0x00, 0x45, 0x01, 0x75, 0x01, 0x95, 0x02, 0x81, 0x02, 0x95, 0x0e, 0x81, 0x03, 0xc0, 0xc0};

/// The keyboard that a receiver has besides: another interface under the same ids.
inline const std::vector<std::uint8_t> kKeyboardDescriptor = {0x05, 0x01, 0x09, 0x06, 0xa1, 0x01, 0x05, 0x07,
                                                              0x19, 0xe0, 0x29, 0xe7, 0x15, 0x00, 0x25, 0x01,
                                                              0x75, 0x01, 0x95, 0x08, 0x81, 0x02, 0xc0};

}  // namespace telenano::support

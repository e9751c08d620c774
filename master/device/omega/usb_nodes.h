#pragma once

#include <string>
#include <vector>

namespace telenano::device {

/// A device on USB as the kernel shows it, whether its SDK can open it or not.
struct UsbNode {
  std::string node;     ///< /dev/bus/usb/BBB/DDD
  std::string product;  ///< as the device calls itself; may be empty
  bool may_open = false;
  std::string
      held_by;  ///< "name (pid)" of a process that has it open, as far as this user may see; else empty
};

/// Roots of the file systems looked at; other ones in tests.
struct UsbRoots {
  std::string sys = "/sys";
  std::string dev = "/dev";
  std::string proc = "/proc";
};

/// Every USB device of that vendor (four hexadecimal digits, lower case).
std::vector<UsbNode> usb_nodes(const std::string& vendor, const UsbRoots& roots = {});

}  // namespace telenano::device

#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "telenano/master/device/omega/omega_device.h"
#include "tests/support/standin_drd/standin_sdk.h"

namespace telenano::device {

inline SdkSearch standin_search(const std::string& folder = "standin_sdk") {
  SdkSearch search;
  search.fdsdk = std::string(TELENANO_STANDINS) + "/" + folder;
  search.loader_names.clear();
  return search;
}

/// A machine without USB, or with what a test puts there.
class FakeUsb {
 public:
  FakeUsb() : root_(std::filesystem::temp_directory_path() / ("telenano_usb_" + std::to_string(::getpid()))) {
    std::filesystem::remove_all(root_);
    std::filesystem::create_directories(root_ / "sys/bus/usb/devices");
    std::filesystem::create_directories(root_ / "dev/bus/usb/001");
    std::filesystem::create_directories(root_ / "proc");
  }
  ~FakeUsb() { std::filesystem::remove_all(root_); }
  FakeUsb(const FakeUsb&) = delete;
  FakeUsb& operator=(const FakeUsb&) = delete;

  UsbRoots roots() const { return {root_ / "sys", root_ / "dev", root_ / "proc"}; }
  std::string node(int number) const {
    char name[16];
    std::snprintf(name, sizeof name, "%03d", number);
    return root_ / "dev/bus/usb/001" / name;
  }
  /// Attaches a device; `openable`: its node is there (the kernel refuses where it may not be opened; a test
  /// that runs as root is refused nothing, so a node that is missing stands for that).
  void attach(int number, const std::string& vendor, const std::string& product, bool openable) {
    const auto folder = root_ / "sys/bus/usb/devices" / ("1-" + std::to_string(number));
    std::filesystem::create_directories(folder);
    std::ofstream(folder / "idVendor") << vendor << "\n";
    std::ofstream(folder / "product") << product << "\n";
    std::ofstream(folder / "busnum") << "1\n";
    std::ofstream(folder / "devnum") << number << "\n";
    if (openable) std::ofstream(node(number)) << "";
  }
  void hold(int number, int pid, const std::string& program) {
    const auto process = root_ / "proc" / std::to_string(pid);
    std::filesystem::create_directories(process / "fd");
    std::ofstream(process / "comm") << program << "\n";
    std::filesystem::create_symlink(node(number), process / "fd/7");
  }

 private:
  std::filesystem::path root_;
};

}  // namespace telenano::device

#include "telenano/master/device/omega/usb_nodes.h"

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>

namespace telenano::device {
namespace {

namespace fs = std::filesystem;

std::string first_line(const fs::path& path) {
  std::ifstream file(path);
  std::string line;
  std::getline(file, line);
  return line;
}

std::string node_of(const fs::path& device, const std::string& dev) {
  char name[32];
  std::snprintf(name, sizeof name, "%03d/%03d", std::atoi(first_line(device / "busnum").c_str()),
                std::atoi(first_line(device / "devnum").c_str()));
  return dev + "/bus/usb/" + name;
}

std::string holder_of(const std::string& node, const std::string& proc) {
  std::error_code error;
  for (fs::directory_iterator it(proc, error), end; !error && it != end; it.increment(error)) {
    const std::string pid = it->path().filename().string();
    if (pid.find_first_not_of("0123456789") != std::string::npos || pid == std::to_string(::getpid()))
      continue;
    std::error_code hidden;  // another user's: not to be seen
    for (fs::directory_iterator fd(it->path() / "fd", hidden), last; !hidden && fd != last;
         fd.increment(hidden)) {
      std::error_code gone;
      if (fs::read_symlink(fd->path(), gone) == node)
        return first_line(it->path() / "comm") + " (" + pid + ")";
    }
  }
  return "";
}

}  // namespace

std::vector<UsbNode> usb_nodes(const std::string& vendor, const UsbRoots& roots) {
  std::vector<UsbNode> nodes;
  std::error_code error;
  for (fs::directory_iterator it(roots.sys + "/bus/usb/devices", error), end; !error && it != end;
       it.increment(error)) {
    if (first_line(it->path() / "idVendor") != vendor) continue;
    UsbNode node;
    node.node = node_of(it->path(), roots.dev);
    node.product = first_line(it->path() / "product");
    node.may_open = ::access(node.node.c_str(), R_OK | W_OK) == 0;
    node.held_by = holder_of(node.node, roots.proc);
    nodes.push_back(std::move(node));
  }
  std::sort(nodes.begin(), nodes.end(), [](const UsbNode& a, const UsbNode& b) { return a.node < b.node; });
  return nodes;
}

}  // namespace telenano::device

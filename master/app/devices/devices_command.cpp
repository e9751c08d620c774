#include "telenano/master/app/devices/devices_command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <string>
#include <vector>

#include "telenano/common/config/print.h"
#include "telenano/master/app/devices/found_devices.h"

namespace telenano::app {
namespace {

/// As RFC 4180 has it: quoted where a comma, a quote or a new line stands in it.
std::string csv(const std::string& text) {
  if (text.find_first_of(",\"\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? "\"\"" : std::string(1, c);
  return quoted + "\"";
}

void list() {
  const std::vector<device::FoundDevice> all = find_devices();
  config::print(stdout, "backend,name,serial,node,usable,why\n");
  for (const auto& one : all) {
    config::print(stdout, "{},{},{},{},{},{}\n", one.backend, csv(one.name), csv(one.serial), csv(one.node),
                  one.usable ? "yes" : "no", csv(one.why));
  }
  std::fflush(stdout);
  for (const auto& one : all) {
    if (!one.why.empty()) config::print(stderr, "{}: {}\n", one.backend, one.why);
  }
}

}  // namespace

CLI::App* add_devices_command(CLI::App& app) {
  CLI::App* const command =
      app.add_subcommand("devices", "List the attached haptic devices, and say why a device cannot be used");
  command->footer(
      "CSV on standard output: backend,name,serial,node,usable,why; what to do on standard error. A backend\n"
      "without any device has one row that says why. Devices are opened and closed, none is moved. Choose "
      "one\n"
      "with run --device BACKEND, among several with serial under [device] in the station file.");
  command->callback([] { list(); });
  return command;
}

}  // namespace telenano::app

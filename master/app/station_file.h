#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "telenano/master/app/devices/device_settings.h"
#include "telenano/master/device/intended_motion.h"
#include "telenano/master/device/plant.h"
#include "telenano/master/loop/link_options.h"
#include "telenano/master/station/station_config.h"

namespace telenano::app {

/// The scales as a person gave them, in the file or by flags: what is left out is planned when the slave is
/// known (station_plan.h).
struct GivenScaling {
  std::optional<double> velocity;
  std::optional<double> force;
};

/// Edges of the cubes of KS fig. 10 as a person gave them; what is left out is the device's and the slave's.
struct Workspaces {
  std::optional<double> haptic_m;
  std::optional<double> visual_m;
  std::optional<double> nano_nm;
};

/// What may be missing from a force before a hand notices is about a tenth of it (Weber).
inline constexpr double kReplyDeadband_permille = 100;
inline constexpr double kReplyDeadbandMost_permille = 500;

/// Everything that deploy/station.toml may say; what it leaves out keeps its default.
struct StationFile {
  station::StationConfig station{};
  bool chooses_method = true;  ///< no method was given, or "auto": control::MethodChoice
  device::PlantConfig
      plant{};  ///< of the simulated device and its operator's hand; its period follows station.rate_hz
  GivenScaling scaling{};  ///< goes into station.scaling as well
  Workspaces workspaces{};
  DeviceSettings device{};
  PedalSettings pedal{};
  loop::LinkOptions link{.reply_deadband = {.permille = kReplyDeadband_permille, .adapts = true}};
  double send_hz = 0;  ///< datagrams a second; 0: as many as the link carries
  /// Of replies, kept to whatever the link does; else link.reply_deadband.permille at most, as the link asks for.
  std::optional<double> kept_reply_deadband_permille;
  int redundancy = 0;                    ///< commands that each datagram repeats, 0 to 4
  std::string companding_tasks = "all";  ///< in which tasks station.companding acts: names and commas, or all
  device::TaskOptions task{};            ///< start_height_nm comes from the session, not from here
  std::string text;                      ///< of the file, for the recording

  /// The name of a method, or "auto". Throws UserError.
  void choose(const std::string& method);
};

/// Of a task's name, "hand" for one's own: station.companding, or none where that is not for this task.
control::CompandingConfig companding_of(const StationFile& file, std::string_view task) noexcept;

/// Throws UserError: one line with file, line, key and expected range; unknown keys are refused.
StationFile load_station_file(const std::string& path);
StationFile parse_station_file(std::string content, const std::string& name);

/// Every setting by its name in the file, so that a recording explains itself.
std::vector<std::pair<std::string, std::string>> describe(const station::StationConfig& station,
                                                          const device::PlantConfig& plant);

/// Its [link], likewise.
/// What the station was told of the haptic device.
std::vector<std::pair<std::string, std::string>> describe_device(const device::DeviceInfo& info);
std::vector<std::pair<std::string, std::string>> describe_link(const StationFile& file);

/// After flags have changed it: checks the whole and makes the simulated device follow the rate.
void finish_station_file(StationFile& file, const std::string& source);

}  // namespace telenano::app

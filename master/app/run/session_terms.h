#pragma once

#include <cstdint>
#include <string>

#include "telenano/common/link/messages.h"
#include "telenano/master/app/link_probe.h"
#include "telenano/master/app/run/run_options.h"
#include "telenano/master/app/station_file.h"
#include "telenano/master/device/haptic_device.h"
#include "telenano/master/station/station.h"

namespace telenano::app {

/// How long a reply is held back at the station; 0 if the newest is taken at once.
double playout_delay_s(const StationFile& file);

/// Why a method shows no force at this round trip, and what to do; empty: it shows it.
std::string too_far_text(const station::StationConfig& config, control::Method method, double rtt_s,
                         const link::Welcome& welcome);

/// How the session will run, and what of the wishes this server or link does not give.
void tell_terms(const StationFile& file, const link::Welcome& welcome, const LinkDelay& link,
                const std::string& scene_name, const station::ScalingCheck& check, const std::string& planned,
                const device::DeviceInfo& device, bool records);

/// What is told of a shared tip before the session begins, and what is asked for.
std::uint32_t tip_wish(const RunOptions& options, const std::string& server, bool shared);

}  // namespace telenano::app

#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "telenano/common/link/messages.h"
#include "telenano/common/recording/recorder.h"
#include "telenano/master/app/devices/session_device.h"
#include "telenano/master/app/link_probe.h"
#include "telenano/master/app/run/run_options.h"
#include "telenano/master/app/station_file.h"
#include "telenano/master/device/haptic_device.h"
#include "telenano/master/station/twin_run.h"

namespace telenano::app {

/// The recording of a session, with what makes the file explain itself; null without --record. `bundle`: of
/// the scene, where it is here; may be null. `twin`: how it runs, of which scene; null: there is none. `marks`:
/// see RecorderOptions::newest_marks. Throws UserError if the file cannot be made.
std::unique_ptr<recording::Recorder> make_recorder(
    const RunOptions& options, const StationFile& file, const link::Welcome& welcome, const LinkDelay& link,
    const SessionDevice& opened, const device::DeviceInfo& device, const std::string& planned,
    std::uint64_t nonce_seed, const std::string& scene_before, const std::string* bundle,
    const station::TwinRunConfig* twin = nullptr, std::uint64_t twin_scene_hash = 0,
    std::function<void(std::vector<recording::MarkRow>& rows)> marks = {});

}  // namespace telenano::app

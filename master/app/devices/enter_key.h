#pragma once

namespace telenano::app {

/// True once Enter was pressed; waits for up to `wait_ms` for a key. Throws RunError at the end of the input.
bool enter_pressed(int wait_ms);

inline constexpr const char* kNotCalibratedYet =
    "The device is not calibrated: move its handle to its calibration point (or start with --home), then "
    "press Enter.";

}  // namespace telenano::app

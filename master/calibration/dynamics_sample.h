#pragma once

namespace telenano::calibration {

/// One tick of an axis: where it was, and the force that was applied until the next tick's. The two have times of their own:
/// on a busy machine the processor may be taken away between the reading and the command, and inside the calls.
struct DynamicsSample {
  double time_s = 0;  ///< of the position
  double position_m = 0;
  double force_time_s = 0;  ///< from when on the force is applied; not before time_s
  double force_n = 0;
  double reading_took_s = 0;  ///< how long the call took: time_s is unknown by half of it
  double command_took_s = 0;  ///< force_time_s is unknown by half of it
};

}  // namespace telenano::calibration

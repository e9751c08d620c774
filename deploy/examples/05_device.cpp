// A haptic device of one's own: a hand behind a pipe. A script, a game pad or a simulation can be the hand.
//
// usage: 05_device HOST:PORT <positions >forces
//
// Lines "x y z" come in: millimetres from the hand's start, z up. Lines "fx fy fz" go out: newtons, whenever
// the force has changed by a millinewton. The session ends with the positions.
#include "pipe_device.h"
#include "run_station.h"
#include "telenano/common/base/error.h"

using namespace telenano;

int main(int argc, char** argv) try {
  if (argc != 2) throw UserError("usage: 05_device HOST:PORT <positions >forces");
  example::PipeDevice device;
  example::run_station(
      argv[1], station::StationConfig{},
      [&](const link::Welcome&) -> device::HapticDevice& { return device; },
      [&](const recording::Sample&) { return !device.ended(); });
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "error: %s\n", error.what());
  return 2;
}

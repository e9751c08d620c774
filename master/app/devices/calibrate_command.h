#pragma once

namespace CLI {
class App;
}

namespace telenano::app {

/// `telenano-master calibrate`: asks a person to push the handle right, away and up, and to move it through
/// its range; prints the [device] table that says so.
CLI::App* add_calibrate_command(CLI::App& app);

}  // namespace telenano::app

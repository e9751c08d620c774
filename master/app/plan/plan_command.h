#pragma once

namespace CLI {
class App;
}

namespace telenano::app {

/// Adds `plan --station FILE (--server HOST:PORT | --limits FILE)`: the scaling for this station, link and
/// slave, as CSV, in words and as a picture. UserError and RunError go through to the caller.
void add_plan_command(CLI::App& app);

}  // namespace telenano::app

#pragma once

namespace CLI {
class App;
}

namespace telenano::studies {

/// `telenano-lab fleet`: thousands of stations that roam over several servers.
void add_fleet_command(CLI::App& app, int& exit_code);

}  // namespace telenano::studies

#pragma once

namespace CLI {
class App;
}

namespace telenano::app {

/// `telenano-master recover FILE...`: makes recordings whose program was killed open plainly everywhere.
void add_recover_command(CLI::App& app);

}  // namespace telenano::app

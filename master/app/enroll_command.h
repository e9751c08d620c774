#pragma once

namespace CLI {
class App;
}

namespace telenano::app {

/// `telenano-master enroll`: makes this station's key pair, and says how a server lets it in.
void add_enroll_command(CLI::App& app);

}  // namespace telenano::app

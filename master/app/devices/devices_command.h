#pragma once

namespace CLI {
class App;
}

namespace telenano::app {

/// `telenano-master devices`: what is attached, over which backend, at which node, why not.
CLI::App* add_devices_command(CLI::App& app);

}  // namespace telenano::app

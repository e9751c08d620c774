#pragma once

namespace CLI {
class App;
}

namespace telenano::app {

/// `telenano-master export FILE.h5`: what is in a recording, as CSV on standard output: its rows, its
/// force-distance curves, its events and marks, its configuration.
void add_export_command(CLI::App& app);

}  // namespace telenano::app

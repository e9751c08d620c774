#pragma once

namespace CLI {
class App;
}

namespace telenano::app {

/// `telenano-master view`: a recording in the station's window.
CLI::App* add_view_command(CLI::App& app);

}  // namespace telenano::app

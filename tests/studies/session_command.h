#pragma once

namespace CLI {
class App;
}

namespace telenano::studies {

/// Adds `session`: a whole session in virtual time, one CSV row a tick.
void add_session_command(CLI::App& app, int& exit_code);

}  // namespace telenano::studies

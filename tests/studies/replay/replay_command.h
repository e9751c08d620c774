#pragma once

namespace CLI {
class App;
}

namespace telenano::studies {

/// `telenano-lab replay FILE.h5`: runs a recorded session again, in virtual time, and says whether every
/// force comes out as recorded, bit for bit. CSV on standard output; exit 1 if not.
void add_replay_command(CLI::App& app, int& exit_code);

}  // namespace telenano::studies

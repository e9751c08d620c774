#pragma once

namespace CLI {
class App;
}

namespace telenano::studies {

/// `telenano-lab stress`: sweeps, shards, merging, replays, mutants. Leaves 1 in `exit_code` where a promise
/// was broken or a mutant survived.
void add_stress_command(CLI::App& app, int& exit_code);

}  // namespace telenano::studies

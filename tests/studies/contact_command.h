#pragma once

namespace CLI {
class App;
}

namespace telenano::studies {

/// Adds `contact` to telenano-lab. It runs as the subcommand's callback and prints to standard output; wrong
/// values throw UserError out of CLI::App::parse.
void add_contact_command(CLI::App& app);

}  // namespace telenano::studies

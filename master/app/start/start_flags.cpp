#include "telenano/master/app/start/start_flags.h"

#include <CLI/CLI.hpp>

namespace telenano::app {

CLI::App* add_start_flags(CLI::App& app, StartFlags& flags) {
  CLI::App* const command = app.add_subcommand(
      "start", "A window to choose a session in: server, hand, method, recording, and what will be felt");
  CLI::Option* const server = command->add_option(
      "--server", flags.server, "HOST:PORT to begin with (default: the one seen last, else 127.0.0.1:5100)");
  command->add_option("--key", flags.key, "Key file of this station for that server")
      ->type_name("FILE")
      ->needs(server);
  command
      ->add_option(
          "--identity", flags.identity,
          "This station's own key pair (telenano-master enroll), instead of --key; with --server-key")
      ->type_name("FILE")
      ->needs(server);
  command
      ->add_option("--server-key", flags.server_key,
                   "The server's public key, as telenano-nve keys identity prints it")
      ->type_name("sha256:HEX")
      ->needs(server);
  command
      ->add_option("--server-scene", flags.server_scene,
                   "Of a server with several scenes, the one of this name (default: its first)")
      ->type_name("NAME")
      ->needs(server);
  command->add_option("--device", flags.device, "Hand to begin with (default sim)")
      ->type_name("{sim,omega,hid,mouse}");
  command
      ->add_option("--text-size", flags.text_size,
                   "Of the words in this window and its sessions, times the screen's own")
      ->capture_default_str()
      ->check(CLI::Range(0.75, 2.5));
  command->footer(
      "Each session runs as the command line that the window shows, and can be begun again when it is over. "
      "Servers\n"
      "that have answered are kept in $XDG_STATE_HOME/telenano/servers (else ~/.local/state). Tab, arrows, "
      "Space and\n"
      "Enter reach everything.");
  return command;
}

}  // namespace telenano::app

#include "telenano/master/app/start/start_flags.h"

#include <CLI/CLI.hpp>

#include "telenano/master/app/devices/device_kinds.h"

namespace telenano::app {

CLI::App* add_start_flags(CLI::App& app, StartFlags& flags) {
  CLI::App* const command = app.add_subcommand("start",
                                               "Open a window to set up a session: server, haptic device, "
                                               "control method, recording, and a preview of the forces");
  CLI::Option* const server =
      command->add_option("--server", flags.server,
                          "HOST:PORT selected first (default: the last server used, else 127.0.0.1:5100)");
  command->add_option("--key", flags.key, "This station's key file for that server")
      ->type_name("FILE")
      ->needs(server);
  command
      ->add_option("--identity", flags.identity,
                   "This station's key pair (telenano-master enroll), instead of --key; needs --server-key")
      ->type_name("FILE")
      ->needs(server);
  command
      ->add_option("--server-key", flags.server_key,
                   "The server's public key, as printed by telenano-nve keys identity")
      ->type_name("sha256:HEX")
      ->needs(server);
  command
      ->add_option("--server-scene", flags.server_scene,
                   "Scene selected first, if the server has several (default: its first)")
      ->type_name("NAME")
      ->needs(server);
  command->add_option("--device", flags.device, "Haptic device selected first (default: sim)")
      ->type_name(choices_text(device_names([](const DeviceRow& row) { return !row.reads_file; })));
  command
      ->add_option("--text-size", flags.text_size,
                   "Text size in this window and its sessions, relative to the screen's own")
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

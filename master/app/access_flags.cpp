#include "telenano/master/app/access_flags.h"

#include <CLI/CLI.hpp>

namespace telenano::app {

void add_access_flags(CLI::App& command, connection::ServerAccess& access) {
  command.add_option("--key", access.key, "This station's key file, for an encrypted session")
      ->type_name("FILE");
  command
      .add_option("--identity", access.identity,
                  "This station's key pair (telenano-master enroll), instead of --key; needs --server-key")
      ->type_name("FILE");
  command
      .add_option("--server-key", access.server_key,
                  "The server's public key, as printed by telenano-nve keys identity; several: "
                  "separated by commas")
      ->type_name("sha256:HEX");
  command
      .add_option("--cert", access.certificate,
                  "This station's certificate (PEM), instead of --key; needs --cert-key and --ca")
      ->type_name("FILE");
  command.add_option("--cert-key", access.certificate_key, "Private key of --cert (PEM)")->type_name("FILE");
  command
      .add_option("--ca", access.authority,
                  "Certificate authorities that are trusted to sign the server's certificate (PEM)")
      ->type_name("FILE");
  command
      .add_option("--connect-timeout-s", access.connect_timeout_s,
                  "How long to wait for the server's first answer")
      ->capture_default_str()
      ->check(CLI::Range(0.1, 60.0));
}

}  // namespace telenano::app

#include "telenano/master/app/access_flags.h"

#include <CLI/CLI.hpp>

namespace telenano::app {

void add_access_flags(CLI::App& command, connection::ServerAccess& access) {
  command.add_option("--key", access.key, "Key file of this station, for an encrypted session")
      ->type_name("FILE");
  command
      .add_option("--cert", access.certificate,
                  "Certificate of this station (PEM), instead of --key; with --cert-key and --ca")
      ->type_name("FILE");
  command.add_option("--cert-key", access.certificate_key, "Private key of --cert (PEM)")->type_name("FILE");
  command
      .add_option("--ca", access.authority, "Authorities that may have signed the server's certificate (PEM)")
      ->type_name("FILE");
  command
      .add_option("--connect-timeout-s", access.connect_timeout_s,
                  "How long to wait for the server's first answer")
      ->capture_default_str()
      ->check(CLI::Range(0.1, 60.0));
}

}  // namespace telenano::app

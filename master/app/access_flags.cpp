#include "telenano/master/app/access_flags.h"

#include <CLI/CLI.hpp>
#include <chrono>

#include "telenano/common/security/connect_token.h"

namespace telenano::app {

void add_access_flags(CLI::App& command, connection::ServerAccess& access) {
  CLI::Option* const token = command.add_option_function<std::string>(
      "--token",
      [&access](const std::string& path) {
        const security::ConnectToken read = security::load_token(path);
        using std::chrono::seconds;
        const auto now = std::chrono::floor<seconds>(std::chrono::system_clock::now());
        security::require_in_force(read, path, now.time_since_epoch().count());
        access.server = read.servers;
        access.token = path;
      },
      "Connect token: servers and a temporary key, instead of --server and --key");
  token->type_name("FILE");
  if (CLI::Option* const server = command.get_option_no_throw("--server")) token->excludes(server);
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

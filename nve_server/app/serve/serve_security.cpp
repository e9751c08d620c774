#include "telenano/nve_server/app/serve/serve_security.h"

#include <CLI/CLI.hpp>
#include <chrono>
#include <filesystem>
#include <utility>

#include "telenano/common/base/error.h"
#include "telenano/common/security/key_admin.h"
#include "telenano/common/security/key_list.h"

namespace telenano::app {

void ServeSecurity::add_flags(CLI::App& command) {
  command
      .add_option("--keys", keys,
                  "Encrypt all sessions and accept only the keys in this list (a file, or the folder that "
                  "contains keys.toml)")
      ->type_name("FILE|DIR");
  command
      .add_option("--cert", certificate,
                  "This server's certificate (PEM), for stations with certificates; needs --cert-key, --ca "
                  "and --keys")
      ->type_name("FILE");
  command.add_option("--cert-key", certificate_key, "Private key of --cert (PEM)")->type_name("FILE");
  command
      .add_option("--ca", authority,
                  "Certificate authorities that are trusted to sign station certificates (PEM)")
      ->type_name("FILE");
  command.add_flag("--insecure", insecure,
                   "Serve without encryption; only on loopback, where this is the default");
}

std::string ServeSecurity::key_list_path() const {
  std::error_code ignored;
  return std::filesystem::is_directory(keys, ignored) ? keys + "/keys.toml" : keys;
}

void ServeSecurity::check(const std::string& listen, bool loopback) const {
  const bool any = !certificate.empty() || !certificate_key.empty() || !authority.empty();
  const bool all = !certificate.empty() && !certificate_key.empty() && !authority.empty();
  if (any && (!all || keys.empty())) {
    throw UserError(
        "--cert, --cert-key, --ca and --keys are used together: the list of keys says which certificates are "
        "accepted; give all four");
  }
  if (insecure && is_secure()) throw UserError("give either --insecure or --keys");
  if (insecure && !loopback)
    throw UserError("--insecure: only on loopback, and --listen " + listen +
                    " is not; give --keys FILE instead");
  if (!is_secure() && !loopback) {
    throw UserError(
        "--listen " + listen +
        ": off loopback sessions are encrypted; give --keys FILE (telenano-nve keys new NAME makes one), or "
        "listen on 127.0.0.1");
  }
}

std::unique_ptr<security::DtlsServer> ServeSecurity::make(std::size_t max_sessions, net::Datagram& wire,
                                                          const rt::Clock& clock) const {
  security::DtlsServerConfig config;
  if (!certificate.empty()) config.certificates = {certificate, certificate_key, authority};
  config.capacity = capacity(max_sessions);
  const std::string identity = security::server_identity_path(key_list_path());
  std::error_code none;
  if (certificate.empty() && std::filesystem::exists(identity, none)) config.identity = identity;
  using std::chrono::floor;
  const auto now = floor<std::chrono::seconds>(std::chrono::system_clock::now());
  const security::KeyList all = security::load_key_list(key_list_path());
  security::KeyList list = all.in_force(now.time_since_epoch().count());
  if (list.empty()) {
    const bool expired = !all.empty();
    throw UserError("--keys " + key_list_path() +
                    (expired ? ": everything in it has expired, so nobody could connect; telenano-nve keys "
                               "list shows when, keys new NAME adds a key"
                             : ": is empty, so nobody could connect; telenano-nve keys new NAME adds a key"));
  }
  if (!all.public_keys.empty() && certificate.empty() && config.identity.empty()) {
    throw UserError("--keys " + key_list_path() +
                    ": has public keys, but this server has no identity to show them: " +
                    "telenano-nve keys identity makes " + identity);
  }
  return std::make_unique<security::DtlsServer>(config, std::move(list), wire, clock);
}

std::string text_of(const security::SecurityCounters& counters) {
  std::string text;
  for (std::size_t i = 0; i < security::kSecurityEvents; ++i) {
    const auto event = static_cast<security::SecurityEvent>(i);
    if (event == security::SecurityEvent::kOpened || counters[event] == 0) continue;
    text +=
        std::string(text.empty() ? "" : ", ") + security::name(event) + " " + std::to_string(counters[event]);
  }
  return text.empty() ? "nothing" : text;
}

}  // namespace telenano::app

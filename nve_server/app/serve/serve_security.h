#pragma once

#include <cstddef>
#include <memory>
#include <string>

#include "telenano/common/net/datagram.h"
#include "telenano/common/rt/clock.h"
#include "telenano/common/security/dtls_server.h"

namespace CLI {
class App;
}

namespace telenano::app {

/// The flags of `serve` that say who may come in.
struct ServeSecurity {
  std::string keys;
  std::string certificate;
  std::string certificate_key;
  std::string authority;
  bool insecure = false;

  void add_flags(CLI::App& command);
  bool is_secure() const noexcept { return !keys.empty(); }
  /// The list's own path: in a folder, its keys.toml.
  std::string key_list_path() const;
  /// Throws UserError, one line: flags that do not go together, or an address off loopback without keys.
  void check(const std::string& listen, bool loopback) const;
  /// Associations at once: for those under way too, and for stations that have come back from another
  /// address. That the server is full is the session's word, which says so.
  static std::size_t capacity(std::size_t max_sessions) noexcept { return 2 * max_sessions + 16; }
  /// Throws UserError for files that do not serve.
  std::unique_ptr<security::DtlsServer> make(std::size_t max_sessions, net::Datagram& wire,
                                             const rt::Clock& clock) const;
};

/// "handshakes 3, failed handshakes 1, forged 12": what is not zero.
std::string text_of(const security::SecurityCounters& counters);

}  // namespace telenano::app

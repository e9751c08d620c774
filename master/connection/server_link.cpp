#include "telenano/master/connection/server_link.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "telenano/common/base/error.h"
#include "telenano/common/link/messages.h"
#include "telenano/common/security/identity_file.h"
#include "telenano/common/security/key_list.h"

namespace telenano::connection {
namespace {

bool wants_security(const ServerAccess& options) {
  return !options.key.empty() || !options.identity.empty() || !options.certificate.empty();
}

void check_together(const ServerAccess& options) {
  const bool any =
      !options.certificate.empty() || !options.certificate_key.empty() || !options.authority.empty();
  const bool all =
      !options.certificate.empty() && !options.certificate_key.empty() && !options.authority.empty();
  if (any && !all) throw UserError("--cert, --cert-key and --ca go together; give all three, or --key FILE");
  if (any && !options.key.empty()) throw UserError("give either --key or --cert");
  if (options.identity.empty() != options.server_key.empty()) {
    throw UserError(
        "--identity and --server-key are used together: telenano-nve keys add prints both when it adds this "
        "station");
  }
  if (!options.identity.empty() && (any || !options.key.empty()))
    throw UserError("--identity: omit --key and --cert");
}

void check_flags(const ServerAccess& options, const net::Address& server) {
  check_together(options);
  if (!net::is_loopback(server) && !wants_security(options)) {
    throw UserError(fmt::format(
        "--server {}: off loopback sessions are encrypted; give --key FILE (telenano-nve keys new makes "
        "one on the server's machine), --identity FILE and --server-key, or --cert, --cert-key and --ca",
        options.server));
  }
}

// "host.lab:5100" → "host.lab", "[::1]:5100" → "::1".
std::string host_of(const std::string& server) {
  const std::string host = server.substr(0, server.rfind(':'));
  return host.size() >= 2 && host.front() == '[' ? host.substr(1, host.size() - 2) : host;
}

/// "sha256:…,sha256:…": the digits of each.
std::vector<std::string> server_keys(const std::string& list) {
  std::vector<std::string> keys;
  for (std::size_t from = 0; from <= list.size();) {
    const std::size_t comma = std::min(list.find(',', from), list.size());
    const std::string name = list.substr(from, comma - from);
    from = comma + 1;
    keys.push_back(security::public_key_digits(name));
    if (keys.back().empty()) {
      throw UserError(
          fmt::format("--server-key '{}': expected \"sha256:\" and 64 lower-case hexadecimal digits, as "
                      "telenano-nve keys identity prints them",
                      name));
    }
  }
  return keys;
}

net::Udp open_socket(const ServerAccess& options, const net::Address& server) {
  check_flags(options, server);
  net::Udp socket = net::Udp::open_for(server);
  socket.notice_unreachable();
  return socket;
}

}  // namespace

ServerLink::ServerLink(const ServerAccess& options, const net::Address& server)
    : socket_(open_socket(options, server)) {
  if (!wants_security(options)) return;
  security::DtlsClientConfig config;
  config.server_name = host_of(options.server);
  if (!options.key.empty()) {
    config.key = security::load_station_key(options.key);
  } else if (!options.identity.empty()) {
    config.identity = options.identity;
    config.server_keys = server_keys(options.server_key);
  } else {
    config.certificates = {options.certificate, options.certificate_key, options.authority};
  }
  dtls_ = std::make_unique<security::DtlsClient>(config, socket_, server, clock_);
}

void ServerLink::practise(const link::PracticeLink& link) {
  if (practice_) return practice_->set(link);
  net::Datagram& inner = datagram();
  practice_ = std::make_unique<PracticeDatagram>(
      inner, []() noexcept { return rt::SteadyClock().now_ns(); }, link);
}

net::Datagram& ServerLink::datagram() noexcept {
  if (practice_) return *practice_;
  if (dtls_) return *dtls_;
  return socket_;
}

std::string ServerLink::failure() const {
  if (!dtls_ || dtls_->established()) return "";
  const std::string why = dtls_->failure();
  return why.empty() ? "" : "; " + why;
}

std::string ServerLink::advice(const std::string& server) const {
  const std::string port = server.substr(server.rfind(':') + 1);
  const std::string start = dtls_ ? "telenano-nve serve with --keys" : "telenano-nve serve";
  switch (socket_.unreachable()) {
    case net::Unreachable::kPort:
      return fmt::format("nothing listens on UDP port {} there: start {}, or correct the port of --server",
                         port, start);
    case net::Unreachable::kHost:
      return "there is no route to that host: check --server, the cable and the network (ip route get)";
    case net::Unreachable::kNo:
      break;
  }
  return fmt::format(
      "no reply: is {} running there{}, and does every firewall on the way let UDP port {} through?", start,
      dtls_ ? "" : " (if it runs with --keys, give --key here; with --local-users, it must list this user)",
      port);
}

void ServerLink::secure(const ServerAccess& options, const std::atomic<bool>& stop) {
  if (!dtls_) return;
  std::array<std::uint8_t, link::kMaxDatagramBytes> buffer;
  net::Received received;
  const std::int64_t start_ns = clock_.now_ns();
  while (!dtls_->established()) {
    dtls_->receive(buffer, received);
    const bool late = static_cast<double>(clock_.now_ns() - start_ns) * 1e-9 > options.connect_timeout_s;
    if (dtls_->refused() || late) {
      const std::string why = dtls_->failure();
      if (!why.empty()) throw RunError(fmt::format("no secure session with {}: {}", options.server, why));
    }
    if (late) {
      throw RunError(fmt::format("no answer from {} within {:g} s; {}", options.server,
                                 options.connect_timeout_s, advice(options.server)));
    }
    if (stop) throw RunError("stopped before the server answered");
    wait_readable(1'000'000);
  }
}

void require_credentials(const ServerAccess& options) {
  check_together(options);
  if (!options.key.empty()) security::load_station_key(options.key);
  if (options.identity.empty()) return;
  security::read_identity_name(options.identity, "--identity");
  server_keys(options.server_key);
}

std::string describe_security(const ServerAccess& options) {
  if (!options.key.empty()) return "DTLS 1.2, key " + security::load_station_key(options.key).identity;
  if (!options.identity.empty()) return "DTLS 1.2, public key of " + options.identity;
  if (!options.certificate.empty()) return "DTLS 1.2, certificate " + options.certificate;
  return "none";
}

}  // namespace telenano::connection

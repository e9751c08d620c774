#include "telenano/common/security/connect_token.h"

#include <algorithm>
#include <array>
#include <charconv>

#include "telenano/common/base/error.h"
#include "telenano/common/base/utc_time.h"
#include "telenano/common/config/toml_document.h"
#include "telenano/common/hash/sha256.h"
#include "telenano/common/security/private_file.h"

namespace telenano::security {
namespace {

constexpr std::string_view kBegin = "t.";
constexpr std::int64_t kLatest_s = 9'999'999'999;

// Up to the next dot, which is taken too.
std::string_view take_word(std::string_view& text) noexcept {
  const std::size_t dot = text.find('.');
  const std::string_view word = text.substr(0, dot);
  text.remove_prefix(dot == std::string_view::npos ? text.size() : dot + 1);
  return word;
}

}  // namespace

std::string token_identity(const TokenName& name) {
  std::string identity = std::string(kBegin) + std::to_string(name.expires_s) + "." +
                         std::string(net::name(name.rights)) + "." + name.issuer + "." + name.station;
  if (!is_identity(name.station) || !is_identity(identity)) {
    const std::size_t room = 64 - (identity.size() - name.station.size());
    throw UserError("station '" + name.station + "': expected a name of 1 to " + std::to_string(room) +
                    " letters, digits, dots, dashes and underscores");
  }
  return identity;
}

std::optional<TokenName> parse_token_name(std::string_view identity) {
  if (!is_identity(identity) || !identity.starts_with(kBegin)) return std::nullopt;
  std::string_view rest = identity.substr(kBegin.size());
  TokenName name;
  const std::string_view expires = take_word(rest);
  const auto [end, error] = std::from_chars(expires.data(), expires.data() + expires.size(), name.expires_s);
  const std::optional<net::Rights> rights = net::parse_rights(take_word(rest));
  name.issuer = take_word(rest);
  name.station = rest;
  if (error != std::errc() || end != expires.data() + expires.size() || name.expires_s < 1 ||
      name.expires_s > kLatest_s || !rights || !is_issuer_name(name.issuer) || name.station.empty())
    return std::nullopt;
  name.rights = *rights;
  // One name for one token: no zeros before the number.
  return token_identity(name) == identity ? std::optional(name) : std::nullopt;
}

Psk token_psk(const Issuer& issuer, std::string_view identity) {
  using namespace std::string_view_literals;
  Psk psk;
  psk.bytes = hmac_sha256(issuer.secret.bytes, std::string("Telenano connect token 1\0"sv).append(identity));
  return psk;
}

ConnectToken make_token(const Issuer& issuer, const TokenName& name, const std::string& servers) {
  if (name.rights > issuer.rights) {
    throw UserError("--rights " + std::string(net::name(name.rights)) + ": the issuer '" + issuer.name +
                    "' gives " + std::string(net::name(issuer.rights)) + " at most");
  }
  const std::string identity = token_identity(name);
  return {servers, {identity, token_psk(issuer, identity)}, name.expires_s};
}

std::string token_text(const ConnectToken& token) {
  return "# A connect token: whoever has this file can open sessions with these servers until it expires\n"
         "# (telenano-master run --token FILE).\n"
         "servers = \"" +
         token.servers + "\"\nexpires = \"" + utc_text(token.expires_s) + "\"\n" + key_lines(token.key);
}

ConnectToken load_token(const std::string& path) {
  const config::TomlDocument document =
      config::TomlDocument::parse(read_private_file(path, "token file"), path);
  ConnectToken token;
  token.servers = document.root().text("servers");
  const std::optional<std::int64_t> expires_s = parse_utc(document.root().text("expires"));
  if (!expires_s) document.root().fail("expires", "expected a moment in UTC as \"2027-01-31T12:00:00Z\"");
  token.expires_s = *expires_s;
  token.key = read_key(document.root());
  document.finish();
  return token;
}

void require_in_force(const ConnectToken& token, const std::string& path, std::int64_t now_s) {
  if (token.expires_s > now_s) return;
  throw UserError("--token " + path + ": has expired at " + utc_text(token.expires_s) +
                  "; ask for another where it came from (telenano-nve token), or set this machine's clock");
}

}  // namespace telenano::security

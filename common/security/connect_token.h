#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "telenano/common/security/key_list.h"

/// Connect tokens: a lab's scheduler or web page lets a station in at some servers for a while, without
/// asking them. It shares a secret with the servers, once (an issuer in their lists of keys). A token is a key
/// whose name says for whom it is, with which right and until when; the key itself is an HMAC of that name
/// under the secret, so each server finds it from the name alone, and nobody without the secret can make one
/// or change what it says.
namespace telenano::security {

/// What a token's name says.
struct TokenName {
  std::string issuer;   ///< is_issuer_name()
  std::string station;  ///< is_identity(), no longer than token_identity() has room for
  net::Rights rights = net::Rights::kOperate;
  std::int64_t expires_s = 0;  ///< Unix time, 1 … 9999999999
};

/// "t.1764010000.operate.lab.omega-1": an is_identity(). Throws UserError where it would be longer than 64.
std::string token_identity(const TokenName& name);
/// None unless it is exactly such a name.
std::optional<TokenName> parse_token_name(std::string_view identity);
/// HMAC-SHA-256 under the issuer's secret over "Telenano connect token 1", a zero byte and the identity.
Psk token_psk(const Issuer& issuer, std::string_view identity);

/// What a station is given: one file.
struct ConnectToken {
  std::string servers;  ///< "HOST:PORT,HOST:PORT"
  StationKey key;
  std::int64_t expires_s = 0;
};

/// Throws UserError for a right beyond the issuer's.
ConnectToken make_token(const Issuer& issuer, const TokenName& name, const std::string& servers);
std::string token_text(const ConnectToken& token);
/// Throws UserError as load_station_key.
ConnectToken load_token(const std::string& path);
/// Throws UserError, with what to do, for one that has expired at `now_s` (Unix time).
void require_in_force(const ConnectToken& token, const std::string& path, std::int64_t now_s);

}  // namespace telenano::security

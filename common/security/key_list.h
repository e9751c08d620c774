#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "telenano/common/net/rights.h"

namespace telenano::security {

/// A pre-shared key: 256 random bits that wipe themselves.
struct Psk {
  static constexpr std::size_t kBytes = 32;
  std::array<std::uint8_t, kBytes> bytes{};

  Psk() = default;
  Psk(const Psk&) = default;
  Psk& operator=(const Psk&) = default;
  ~Psk();
};

/// In constant time.
bool equal(const Psk& a, const Psk& b) noexcept;

/// What a station holds: its name and its key.
struct StationKey {
  std::string identity;
  Psk psk;
};

/// Reads a file as `telenano-nve keys new` writes it. Throws UserError: one line with file, key and what is
/// expected, never with a secret.
StationKey load_station_key(const std::string& path);
std::string station_key_text(const StationKey& key);

struct KeyEntry {
  std::string identity;
  Psk psk;
  net::Rights rights = net::Rights::kOperate;
  std::optional<std::int64_t> expires_s{};  ///< Unix time from which on it opens nothing; left out: never
};

/// A certificate that an authority of the server's has signed, known by its common name or its SHA-256.
struct CertificateEntry {
  std::string name;         ///< common name; empty if by fingerprint
  std::string fingerprint;  ///< 64 lower-case hexadecimal digits; empty if by name
  net::Rights rights = net::Rights::kOperate;
  std::optional<std::int64_t> expires_s{};  ///< as for a key; the certificate's own end counts besides
};

/// A station that holds a key pair of its own (identity_file.h), known by its public key. Two entries of one name
/// are one station that changes over from one pair to the next.
struct PublicKeyEntry {
  std::string identity;
  std::string public_key;  ///< 64 lower-case hexadecimal digits
  net::Rights rights = net::Rights::kOperate;
  std::optional<std::int64_t> expires_s{};  ///< as for a key
};

/// Who may come in, and what each may do: the server's allow-list. What is not in it is refused.
struct KeyList {
  std::vector<KeyEntry> keys;
  std::vector<CertificateEntry> certificates;
  std::vector<PublicKeyEntry> public_keys;

  bool empty() const noexcept { return keys.empty() && certificates.empty() && public_keys.empty(); }

  const KeyEntry* find_key(std::string_view identity) const noexcept;
  /// A fingerprint wins over a name.
  const CertificateEntry* find_certificate(std::string_view name,
                                           std::string_view fingerprint) const noexcept;

  const PublicKeyEntry* find_public_key(std::string_view public_key) const noexcept;

  /// What is in force at `now_s` (Unix time): without what has expired.
  KeyList in_force(std::int64_t now_s) const;
  /// The first moment after `now_s` at which something expires; none if nothing will.
  std::optional<std::int64_t> next_expiry_s(std::int64_t now_s) const noexcept;
};

/// Reads the list: TOML with tables [[key]] (identity, psk, rights) and [[certificate]] (name or fingerprint,
/// rights) and [[public]] (identity, key, rights), and in each `expires` where it ends ("2027-01-31T12:00:00Z").
/// Also gives what has expired. Throws UserError as load_station_key.
KeyList load_key_list(const std::string& path);
KeyList parse_key_list(std::string content, const std::string& name);
std::string key_list_text(const KeyList& list);

/// net::Standing::identity of a key ('k'), a certificate ('c', its listed name or fingerprint) or a public key
/// ('p', the station's name, whichever of its pairs it shows); never 0.
/// The names are those of the list, so that nobody can choose one that collides.
std::uint64_t identity_number(char kind, std::string_view identity) noexcept;

/// 1 to 64 letters, digits, dots, dashes and underscores: goes over the wire in the clear, into messages and
/// file names.
bool is_identity(std::string_view text) noexcept;

}  // namespace telenano::security

#include "telenano/common/security/key_list.h"

#include <string.h>

#include <algorithm>
#include <optional>

#include "telenano/common/base/error.h"
#include "telenano/common/base/utc_time.h"
#include "telenano/common/config/toml_document.h"
#include "telenano/common/link/siphash.h"
#include "telenano/common/security/identity_file.h"
#include "telenano/common/security/private_file.h"

namespace telenano::security {
namespace {

using config::TomlDocument;
using config::TomlTable;

constexpr std::string_view kHexDigits = "0123456789abcdef";

std::optional<Psk> parse_psk(const std::string& text) {
  if (text.size() != 2 * Psk::kBytes) return std::nullopt;
  Psk psk;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const std::size_t digit = kHexDigits.find(text[i]);
    if (digit == std::string_view::npos) return std::nullopt;
    psk.bytes[i / 2] = static_cast<std::uint8_t>(std::size_t{16} * psk.bytes[i / 2] + digit);
  }
  return psk;
}

std::string hex(const Psk& psk) {
  std::string text;
  for (const std::uint8_t byte : psk.bytes) {
    text += kHexDigits[byte / 16];
    text += kHexDigits[byte % 16];
  }
  return text;
}

std::string read_identity(const TomlTable& table) {
  std::string identity = table.text("identity");
  if (!is_identity(identity))
    table.fail("identity", "expected 1 to 64 letters, digits, dots, dashes and underscores");
  return identity;
}

Psk read_psk(const TomlTable& table) {
  std::string text = table.text("psk");
  const std::optional<Psk> psk = parse_psk(text);
  ::explicit_bzero(text.data(), text.size());
  if (!psk) {
    table.fail("psk", "expected " + std::to_string(2 * Psk::kBytes) +
                          " lower-case hexadecimal digits, as telenano-nve keys new writes them");
  }
  return *psk;
}

net::Rights read_rights(const TomlTable& table) {
  const std::vector<std::string> names(net::kRightsNames.begin(), net::kRightsNames.end());
  return *net::parse_rights(table.choice("rights", names));
}

std::optional<std::int64_t> read_expiry(const TomlTable& table) {
  const std::string text = table.text_or("expires", "");
  if (text.empty()) return std::nullopt;
  const std::optional<std::int64_t> expires_s = parse_utc(text);
  if (!expires_s) table.fail("expires", "expected a moment in UTC as \"2027-01-31T12:00:00Z\"");
  return expires_s;
}

std::string expiry_line(std::optional<std::int64_t> expires_s) {
  return expires_s ? "expires = \"" + utc_text(*expires_s) + "\"\n" : "";
}

bool is_fingerprint(std::string_view text) {
  return text.size() == 64 && text.find_first_not_of(kHexDigits) == std::string_view::npos;
}

CertificateEntry read_certificate(const TomlTable& table) {
  CertificateEntry entry;
  entry.name = table.text_or("name", "");
  entry.fingerprint = table.text_or("fingerprint", "");
  if (entry.name.empty() == entry.fingerprint.empty())
    table.fail("name", "expected either a name or a fingerprint");
  if (!entry.name.empty() && !is_identity(entry.name))
    table.fail("name", "expected 1 to 64 letters, digits, dots, dashes and underscores");
  if (!entry.fingerprint.empty() && !is_fingerprint(entry.fingerprint)) {
    table.fail("fingerprint",
               "expected the SHA-256 of the certificate as 64 lower-case hexadecimal digits without colons");
  }
  entry.rights = read_rights(table);
  entry.expires_s = read_expiry(table);
  return entry;
}

PublicKeyEntry read_public_key(const TomlTable& table) {
  PublicKeyEntry entry;
  entry.identity = read_identity(table);
  entry.public_key = public_key_digits(table.text("key"));
  if (entry.public_key.empty())
    table.fail(
        "key",
        "expected \"sha256:\" and 64 lower-case hexadecimal digits, as telenano-master enroll prints them");
  entry.rights = read_rights(table);
  entry.expires_s = read_expiry(table);
  return entry;
}

}  // namespace

std::string public_key_digits(std::string_view name) {
  constexpr std::string_view kHash = "sha256:";
  if (name.starts_with(kHash)) name.remove_prefix(kHash.size());
  return is_fingerprint(name) ? std::string(name) : std::string();
}

Psk::~Psk() {
  ::explicit_bzero(bytes.data(), bytes.size());
}

bool equal(const Psk& a, const Psk& b) noexcept {
  unsigned difference = 0;
  for (std::size_t i = 0; i < Psk::kBytes; ++i) difference |= static_cast<unsigned>(a.bytes[i] ^ b.bytes[i]);
  return difference == 0;
}

std::uint64_t identity_number(char kind, std::string_view identity) noexcept {
  const link::SipKey key{static_cast<std::uint64_t>(kind), 0};
  return std::max<std::uint64_t>(
      link::siphash(key, {reinterpret_cast<const std::uint8_t*>(identity.data()), identity.size()}), 1);
}

bool is_identity(std::string_view text) noexcept {
  return !text.empty() && text.size() <= 64 && std::all_of(text.begin(), text.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' ||
           c == '-' || c == '_';
  });
}

StationKey load_station_key(const std::string& path) {
  const TomlDocument document = TomlDocument::parse(read_private_file(path, "key file"), path);
  StationKey key{read_identity(document.root()), read_psk(document.root())};
  document.finish();
  return key;
}

std::string station_key_text(const StationKey& key) {
  return "# A station's key: whoever has this file can open sessions with the server. Carry it by hand or "
         "scp.\nidentity = \"" +
         key.identity + "\"\npsk = \"" + hex(key.psk) + "\"\n";
}

const KeyEntry* KeyList::find_key(std::string_view identity) const noexcept {
  const auto found = std::find_if(keys.begin(), keys.end(),
                                  [&](const KeyEntry& entry) { return entry.identity == identity; });
  return found == keys.end() ? nullptr : &*found;
}

const CertificateEntry* KeyList::find_certificate(std::string_view name,
                                                  std::string_view fingerprint) const noexcept {
  const CertificateEntry* by_name = nullptr;
  for (const CertificateEntry& entry : certificates) {
    if (!entry.fingerprint.empty() && entry.fingerprint == fingerprint) return &entry;
    if (!entry.name.empty() && entry.name == name) by_name = &entry;
  }
  return by_name;
}

const PublicKeyEntry* KeyList::find_public_key(std::string_view public_key) const noexcept {
  const auto found = std::find_if(public_keys.begin(), public_keys.end(), [&](const PublicKeyEntry& entry) {
    return entry.public_key == public_key;
  });
  return found == public_keys.end() ? nullptr : &*found;
}

KeyList KeyList::in_force(std::int64_t now_s) const {
  KeyList list = *this;
  const auto expired = [now_s](const auto& entry) { return entry.expires_s && *entry.expires_s <= now_s; };
  std::erase_if(list.keys, expired);
  std::erase_if(list.certificates, expired);
  std::erase_if(list.public_keys, expired);
  return list;
}

std::optional<std::int64_t> KeyList::next_expiry_s(std::int64_t now_s) const noexcept {
  std::optional<std::int64_t> next_s;
  const auto look = [&](const auto& entries) {
    for (const auto& entry : entries) {
      if (entry.expires_s && *entry.expires_s > now_s && (!next_s || *entry.expires_s < *next_s))
        next_s = entry.expires_s;
    }
  };
  look(keys);
  look(certificates);
  look(public_keys);
  return next_s;
}

KeyList load_key_list(const std::string& path) {
  return parse_key_list(read_private_file(path, "--keys"), path);
}

KeyList parse_key_list(std::string content, const std::string& name) {
  const TomlDocument document = TomlDocument::parse(std::move(content), name);
  KeyList list;
  for (const TomlTable& table : document.root().tables("key")) {
    KeyEntry entry{read_identity(table), read_psk(table), read_rights(table), read_expiry(table)};
    if (list.find_key(entry.identity) != nullptr)
      table.fail("identity", "'" + entry.identity + "' comes twice");
    list.keys.push_back(std::move(entry));
  }
  for (const TomlTable& table : document.root().tables("certificate")) {
    CertificateEntry entry = read_certificate(table);
    const bool twice =
        std::any_of(list.certificates.begin(), list.certificates.end(), [&](const CertificateEntry& e) {
          return e.name == entry.name && e.fingerprint == entry.fingerprint;
        });
    if (twice) table.fail(entry.name.empty() ? "fingerprint" : "name", "comes twice");
    list.certificates.push_back(std::move(entry));
  }
  for (const TomlTable& table : document.root().tables("public")) {
    PublicKeyEntry entry = read_public_key(table);
    if (list.find_public_key(entry.public_key) != nullptr) table.fail("key", "comes twice");
    list.public_keys.push_back(std::move(entry));
  }
  document.finish();
  return list;
}

std::string key_list_text(const KeyList& list) {
  std::string text =
      "# Who may open sessions with this server. telenano-nve keys new and revoke rewrite this file and keep "
      "no\n"
      "# comments; entries may also be edited by hand. A running server takes changes up within two "
      "seconds.\n";
  for (const KeyEntry& entry : list.keys) {
    text += "\n[[key]]\nidentity = \"" + entry.identity + "\"\npsk = \"" + hex(entry.psk) +
            "\"\nrights = \"" + std::string(net::name(entry.rights)) + "\"\n" + expiry_line(entry.expires_s);
  }
  for (const CertificateEntry& entry : list.certificates) {
    text += "\n[[certificate]]\n" +
            (entry.name.empty() ? "fingerprint = \"" + entry.fingerprint : "name = \"" + entry.name) +
            "\"\nrights = \"" + std::string(net::name(entry.rights)) + "\"\n" + expiry_line(entry.expires_s);
  }
  for (const PublicKeyEntry& entry : list.public_keys) {
    text += "\n[[public]]\nidentity = \"" + entry.identity + "\"\nkey = \"sha256:" + entry.public_key +
            "\"\nrights = \"" + std::string(net::name(entry.rights)) + "\"\n" + expiry_line(entry.expires_s);
  }
  return text;
}

}  // namespace telenano::security

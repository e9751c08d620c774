#include "telenano/common/security/key_admin.h"

#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <utility>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/base/utc_time.h"
#include "telenano/common/config/edit_distance.h"
#include "telenano/common/security/identity_file.h"
#include "telenano/common/security/private_file.h"

namespace telenano::security {
namespace {

// 32 bytes come whole or not at all, but for a signal while the generator starts.
Psk fresh_psk() {
  Psk psk;
  while (::getrandom(psk.bytes.data(), psk.bytes.size(), 0) != static_cast<ssize_t>(psk.bytes.size())) {
    if (errno != EINTR) throw RunError("the kernel gives no random numbers");
  }
  return psk;
}

bool exists(const std::string& path) {
  struct stat info {};
  return ::stat(path.c_str(), &info) == 0;
}

// The station's file first: a key in the list that nobody holds is worse than a file that opens nothing.
void add_key(KeyList list, const KeyEntry& entry, const std::string& list_path,
             const std::string& station_path) {
  list.keys.push_back(entry);
  create_private_file(station_path, station_key_text({entry.identity, entry.psk}), "--out");
  try {
    replace_private_file(list_path, key_list_text(list), "--keys");
  } catch (...) {
    ::unlink(station_path.c_str());
    throw;
  }
}

[[noreturn]] void refuse_unknown(const KeyList& list, const std::string& list_path,
                                 const std::string& identity, const char* what) {
  std::vector<std::string> known;
  for (const auto& entry : list.keys) known.push_back(entry.identity);
  for (const auto& entry : list.certificates) known.push_back(entry.name);
  for (const auto& entry : list.public_keys) known.push_back(entry.identity);
  const std::string near = config::nearest_name(identity, known);
  throw UserError("--keys " + list_path + ": has no " + what + " '" + identity + "'" +
                  (near.empty() ? "; see telenano-nve keys list" : "; did you mean '" + near + "'?"));
}

}  // namespace

void new_key(const std::string& list_path, const std::string& identity, net::Rights rights,
             const std::string& station_path, std::optional<std::int64_t> expires_s) {
  if (!is_identity(identity)) {
    throw UserError("key '" + identity +
                    "': expected a name of 1 to 64 letters, digits, dots, dashes and underscores");
  }
  const PrivateFileLock lock(list_path, "--keys");
  KeyList list;
  if (exists(list_path)) list = load_key_list(list_path);
  if (list.find_key(identity) != nullptr) {
    throw UserError("--keys " + list_path + ": has a key '" + identity +
                    "' already; choose another name, or revoke it first");
  }
  add_key(std::move(list), {identity, fresh_psk(), rights, expires_s}, list_path, station_path);
}

std::string server_identity_path(const std::string& list_path) {
  const auto slash = list_path.rfind('/');
  return (slash == std::string::npos ? "" : list_path.substr(0, slash + 1)) + "server.id";
}

std::string server_identity(const std::string& list_path, bool& made) {
  const std::string path = server_identity_path(list_path);
  made = !exists(path);
  return made ? create_identity(path, "--keys") : read_identity_name(path, "--keys");
}

net::Rights add_public_key(const std::string& list_path, const std::string& identity,
                           const std::string& public_key, std::optional<net::Rights> rights,
                           std::optional<std::int64_t> expires_s, std::optional<std::int64_t> old_expires_s) {
  if (!is_identity(identity)) {
    throw UserError("key '" + identity +
                    "': expected a name of 1 to 64 letters, digits, dots, dashes and underscores");
  }
  PublicKeyEntry entry{identity, public_key_digits(public_key), net::Rights::kOperate, expires_s};
  if (entry.public_key.empty()) {
    throw UserError("--public '" + public_key +
                    "': expected \"sha256:\" and 64 lower-case hexadecimal digits, as telenano-master enroll "
                    "prints them");
  }
  const PrivateFileLock lock(list_path, "--keys");
  KeyList list;
  if (exists(list_path)) list = load_key_list(list_path);
  if (const PublicKeyEntry* const same = list.find_public_key(entry.public_key)) {
    throw UserError("--keys " + list_path + ": has this public key already, as '" + same->identity + "'");
  }
  for (PublicKeyEntry& old : list.public_keys) {
    if (old.identity != identity) continue;
    if (!old_expires_s) {
      throw UserError("--keys " + list_path + ": has a public key of '" + identity +
                      "' already; let both in for a while with --overlap-days, or revoke it first");
    }
    entry.rights = old.rights;
    old.expires_s = std::min(old.expires_s.value_or(*old_expires_s), *old_expires_s);
  }
  entry.rights = rights.value_or(entry.rights);
  for (PublicKeyEntry& old : list.public_keys) {
    if (old.identity == identity) old.rights = entry.rights;  // one station, one right
  }
  const net::Rights given = entry.rights;
  list.public_keys.push_back(std::move(entry));
  replace_private_file(list_path, key_list_text(list), "--keys");
  return given;
}

std::string next_identity(const KeyList& list, const std::string& identity) {
  std::string base = identity;
  unsigned number = 2;
  const std::size_t dot = identity.rfind('.');
  const bool numbered = dot != std::string::npos && dot > 0 && identity.size() - dot - 1 >= 1 &&
                        identity.size() - dot - 1 <= 4 &&
                        identity.find_first_not_of("0123456789", dot + 1) == std::string::npos;
  if (numbered) {
    base = identity.substr(0, dot);
    number = static_cast<unsigned>(std::stoul(identity.substr(dot + 1))) + 1;
  }
  std::string name;
  do {
    name = base + "." + std::to_string(number++);
  } while (list.find_key(name) != nullptr);
  return name;
}

std::string rotate_key(const std::string& list_path, const std::string& identity,
                       const std::string& station_path, std::int64_t old_expires_s,
                       std::optional<std::int64_t> expires_s) {
  if (!exists(list_path)) load_key_list(list_path);  // says so, and leaves no lock beside what is not there
  const PrivateFileLock lock(list_path, "--keys");
  KeyList list = load_key_list(list_path);
  const auto old = std::find_if(list.keys.begin(), list.keys.end(),
                                [&](const KeyEntry& entry) { return entry.identity == identity; });
  if (old == list.keys.end()) refuse_unknown(list, list_path, identity, "key");
  const std::string name = next_identity(list, identity);
  if (!is_identity(name)) {
    throw UserError("key '" + identity + "': its name is too long to be followed by '" + name +
                    "'; make a new one with telenano-nve keys new, and revoke this one");
  }
  const net::Rights rights = old->rights;
  old->expires_s = std::min(old->expires_s.value_or(old_expires_s), old_expires_s);
  add_key(std::move(list), {name, fresh_psk(), rights, expires_s}, list_path,
          station_path.empty() ? name + ".key" : station_path);
  return name;
}

void revoke_key(const std::string& list_path, const std::string& identity) {
  if (!exists(list_path)) load_key_list(list_path);  // says so, and leaves no lock beside what is not there
  const PrivateFileLock lock(list_path, "--keys");
  KeyList list = load_key_list(list_path);
  const std::size_t removed =
      std::erase_if(list.keys, [&](const KeyEntry& entry) { return entry.identity == identity; }) +
      std::erase_if(list.certificates,
                    [&](const CertificateEntry& entry) {
                      return entry.name == identity || entry.fingerprint == identity;
                    }) +
      std::erase_if(list.public_keys, [&](const PublicKeyEntry& entry) {
        return entry.identity == identity || entry.public_key == public_key_digits(identity);
      });
  if (removed == 0) refuse_unknown(list, list_path, identity, "key or certificate");
  replace_private_file(list_path, key_list_text(list), "--keys");
}

std::string list_keys(const std::string& list_path) {
  const KeyList list = load_key_list(list_path);
  std::string csv = "kind,identity,rights,expires\n";
  const auto line = [&csv](const std::string& kind, const std::string& name, const auto& entry) {
    csv += kind + "," + name + "," + std::string(net::name(entry.rights)) + "," +
           (entry.expires_s ? utc_text(*entry.expires_s) : "") + "\n";
  };
  for (const auto& entry : list.keys) line("psk", entry.identity, entry);
  for (const auto& entry : list.certificates)
    line("certificate", entry.name.empty() ? "sha256:" + entry.fingerprint : entry.name, entry);
  for (const auto& entry : list.public_keys)
    line("public", entry.identity + " sha256:" + entry.public_key, entry);
  return csv;
}

}  // namespace telenano::security

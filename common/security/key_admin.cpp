#include "telenano/common/security/key_admin.h"

#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/config/edit_distance.h"
#include "telenano/common/security/key_list.h"
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

}  // namespace

void new_key(const std::string& list_path, const std::string& identity, net::Rights rights,
             const std::string& station_path) {
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
  const Psk psk = fresh_psk();
  list.keys.push_back({identity, psk, rights});
  // The station's file first: a key in the list that nobody holds is worse than a file that opens nothing.
  create_private_file(station_path, station_key_text({identity, psk}), "--out");
  try {
    replace_private_file(list_path, key_list_text(list), "--keys");
  } catch (...) {
    ::unlink(station_path.c_str());
    throw;
  }
}

void revoke_key(const std::string& list_path, const std::string& identity) {
  if (!exists(list_path)) load_key_list(list_path);  // says so, and leaves no lock beside what is not there
  const PrivateFileLock lock(list_path, "--keys");
  KeyList list = load_key_list(list_path);
  const std::size_t removed =
      std::erase_if(list.keys, [&](const KeyEntry& entry) { return entry.identity == identity; }) +
      std::erase_if(list.certificates, [&](const CertificateEntry& entry) {
        return entry.name == identity || entry.fingerprint == identity;
      });
  if (removed == 0) {
    std::vector<std::string> known;
    for (const auto& entry : list.keys) known.push_back(entry.identity);
    for (const auto& entry : list.certificates) known.push_back(entry.name);
    const std::string near = config::nearest_name(identity, known);
    throw UserError("--keys " + list_path + ": has no key or certificate '" + identity + "'" +
                    (near.empty() ? "; see telenano-nve keys list" : "; did you mean '" + near + "'?"));
  }
  replace_private_file(list_path, key_list_text(list), "--keys");
}

std::string list_keys(const std::string& list_path) {
  const KeyList list = load_key_list(list_path);
  std::string csv = "kind,identity,rights\n";
  for (const auto& entry : list.keys)
    csv += "psk," + entry.identity + "," + std::string(net::name(entry.rights)) + "\n";
  for (const auto& entry : list.certificates) {
    csv += "certificate," + (entry.name.empty() ? "sha256:" + entry.fingerprint : entry.name) + "," +
           std::string(net::name(entry.rights)) + "\n";
  }
  return csv;
}

}  // namespace telenano::security

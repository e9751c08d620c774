#pragma once

#include <string>

#include "telenano/common/net/rights.h"

namespace telenano::security {

/// A fresh key from the kernel's generator: added to the list (which is made if there is none) and written to
/// `station_path` for the station. Throws UserError if the identity or the file exists already. Programs that
/// change one list at the same time wait for each other (PrivateFileLock).
void new_key(const std::string& list_path, const std::string& identity, net::Rights rights,
             const std::string& station_path);

/// Takes a key (by its identity) or a certificate (by name or fingerprint) off the list. Throws UserError,
/// with the nearest name, if there is no such one.
void revoke_key(const std::string& list_path, const std::string& identity);

/// CSV with header: kind,identity,rights. No secrets.
std::string list_keys(const std::string& list_path);

}  // namespace telenano::security

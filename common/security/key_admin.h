#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "telenano/common/net/rights.h"
#include "telenano/common/security/key_list.h"

namespace telenano::security {

/// A fresh key from the kernel's generator: added to the list (which is made if there is none) and written to
/// `station_path` for the station. It opens nothing from `expires_s` on (Unix time; left out: never expires).
/// Throws UserError if the identity or the file exists already. Programs that change one list at the same
/// time wait for each other (PrivateFileLock).
void new_key(const std::string& list_path, const std::string& identity, net::Rights rights,
             const std::string& station_path, std::optional<std::int64_t> expires_s = {});

/// The name of the key that follows `identity`: "omega-1" → "omega-1.2" → "omega-1.3", past those in the
/// list. A key's name goes over the wire before its secret is known, so two keys that are in force together
/// need two names.
std::string next_identity(const KeyList& list, const std::string& identity);

/// A key that follows `identity`, with its rights, under next_identity(); written to `station_path` ("": its
/// name with .key). The old one stays in force until `old_expires_s`, or its own end if that is sooner, so
/// that a station can change over meanwhile. Returns the new name. Throws UserError as new_key, and if there
/// is no such key.
std::string rotate_key(const std::string& list_path, const std::string& identity,
                       const std::string& station_path, std::int64_t old_expires_s,
                       std::optional<std::int64_t> expires_s = {});

/// What a server is known by to stations with a public key: `server.id` beside its list.
std::string server_identity_path(const std::string& list_path);
/// Its name ("sha256:…"); made, where there is none yet. `made`: it was.
std::string server_identity(const std::string& list_path, bool& made);

/// Lets a station in by its public key (identity_file.h), of which the server holds no secret. Where the list has
/// that name already, the station gets a second pair beside the first, with the same rights: all earlier ones end
/// at `old_expires_s`, or sooner if they did; left out: UserError. `rights` left out: those that it had, or to
/// operate. Returns the rights.
net::Rights add_public_key(const std::string& list_path, const std::string& identity,
                           const std::string& public_key, std::optional<net::Rights> rights,
                           std::optional<std::int64_t> expires_s, std::optional<std::int64_t> old_expires_s);

/// Takes a key (by its identity), a public key (by name, or "sha256:…" for one of several) or a certificate (by
/// name or fingerprint) off the list.
/// Throws UserError, with the nearest name, if there is no such one.
void revoke_key(const std::string& list_path, const std::string& identity);

/// CSV with header: kind,identity,rights,expires (UTC; empty: never). No secrets; with what has expired.
std::string list_keys(const std::string& list_path);

}  // namespace telenano::security

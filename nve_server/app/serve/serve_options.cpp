#include "telenano/nve_server/app/serve/serve_options.h"

#include <algorithm>
#include <utility>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/app/serve/local_users.h"

namespace telenano::app {
namespace {

/// What is shared or shown of one scene only.
void check_several(const ServeOptions& options) {
  if (options.scenes.size() < 2) return;
  for (std::size_t i = 1; i < options.scenes.size(); ++i) {
    if (std::find(options.scenes.begin(), options.scenes.begin() + static_cast<std::ptrdiff_t>(i),
                  options.scenes[i]) != options.scenes.begin() + static_cast<std::ptrdiff_t>(i))
      throw UserError("--scene " + options.scenes[i] + ": given twice; give each scene once");
  }
  if (options.afm.wanted())
    throw UserError(
        "--scene: given several times, but an AFM has one sample: the one under its tip; leave it out");
  if (options.share == "one-tip")
    throw UserError(
        "--share one-tip: with several --scene each session has a tip of its own; serve one scene, or leave "
        "this out");
  if (!options.web.empty()) throw UserError("--web: shows one scene; serve one --scene, or leave this out");
}

/// Who may connect without a key; left out: every local user.
std::optional<LocalUserList> local_users_of(const ServeOptions& options) {
  if (!options.local_rights.empty() && options.security.is_secure())
    throw UserError(
        "--local-rights: with --keys every station has the rights of its key (telenano-nve keys new "
        "--rights); omit --local-rights");
  if (options.local_users.empty()) return std::nullopt;
  if (options.security.is_secure() || !options.local_rights.empty())
    throw UserError("--local-users: lists who may connect without a key; omit --keys and --local-rights");
  return LocalUserList::parse(options.local_users);
}

}  // namespace

std::string names_of(const ServeOptions& options) {
  std::string names = options.afm.served(options.scene());
  for (std::size_t i = 1; i < options.scenes.size(); ++i) names += ", " + options.scenes[i];
  return names;
}

WorkersConfig checked_workers(ServeOptions& options) {
  check_several(options);
  options.afm.check(options.scene(), options.share);
  const net::Address address = net::parse_address(options.listen, "--listen");
  options.security.check(options.listen, net::is_loopback(address));
  std::optional<LocalUserList> local_users = local_users_of(options);
  WorkersConfig config{address, options.max_sessions, options.busy_poll, options.realtime_priority};
  config.sessions_per_peer =
      options.sessions_per_peer.value_or(default_sessions_per_peer(options.max_sessions));
  if (!options.local_rights.empty()) config.local_rights = *net::parse_rights(options.local_rights);
  config.local_users = std::move(local_users);
  config.audit = !options.audit.empty();
  return config;
}

}  // namespace telenano::app

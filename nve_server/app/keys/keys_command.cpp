#include "telenano/nve_server/app/keys/keys_command.h"

#include <CLI/CLI.hpp>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "telenano/common/base/utc_time.h"
#include "telenano/common/net/rights.h"
#include "telenano/common/security/key_admin.h"

namespace telenano::app {
namespace {

struct KeysOptions {
  std::string list = "keys.toml";
  std::string name;
  std::string rights = "operate";
  std::string out;
  std::string public_key;
  std::optional<std::string> public_rights;
  std::optional<double> public_overlap_days;
  std::optional<double> days;
  double overlap_days = 7;
};

// The moment so many days from now.
std::int64_t in_days(double days) {
  using std::chrono::seconds;
  const auto now = std::chrono::floor<seconds>(std::chrono::system_clock::now());
  return now.time_since_epoch().count() + static_cast<std::int64_t>(std::llround(86400 * days));
}

std::optional<std::int64_t> end_of(const KeysOptions& options) {
  return options.days ? std::optional(in_days(*options.days)) : std::nullopt;
}

std::string until(std::optional<std::int64_t> expires_s) {
  return expires_s ? " until " + utc_text(*expires_s) : "";
}

void make_key(const KeysOptions& options) {
  const std::string out = options.out.empty() ? options.name + ".key" : options.out;
  const std::optional<std::int64_t> expires_s = end_of(options);
  security::new_key(options.list, options.name, *net::parse_rights(options.rights), out, expires_s);
  std::fprintf(stderr,
               "telenano-nve: key '%s' may %s%s; copy %s to its station (telenano-master run --key), then "
               "delete it here\n",
               options.name.c_str(), options.rights.c_str(), until(expires_s).c_str(), out.c_str());
}

void rotate_key(const KeysOptions& options) {
  const std::int64_t old_expires_s = in_days(options.overlap_days);
  const std::optional<std::int64_t> expires_s = end_of(options);
  const std::string name =
      security::rotate_key(options.list, options.name, options.out, old_expires_s, expires_s);
  const std::string out = options.out.empty() ? name + ".key" : options.out;
  std::fprintf(stderr,
               "telenano-nve: key '%s' replaces '%s' with the same rights%s; copy %s to the station before "
               "%s, when the old key expires at the latest, then delete it here\n",
               name.c_str(), options.name.c_str(), until(expires_s).c_str(), out.c_str(),
               utc_text(old_expires_s).c_str());
}

/// Made at the first station that is let in: the line for it says by what it knows this server.
std::string server_identity(const std::string& list) {
  bool made = false;
  const std::string name = security::server_identity(list, made);
  if (made) {
    std::fprintf(stderr,
                 "telenano-nve: created this server's identity, %s; restart a running server to use it\n",
                 security::server_identity_path(list).c_str());
  }
  return name;
}

void add_public_key(const KeysOptions& options) {
  const auto rights = options.public_rights ? net::parse_rights(*options.public_rights) : std::nullopt;
  const std::optional<std::int64_t> old_expires_s =
      options.public_overlap_days ? std::optional(in_days(*options.public_overlap_days)) : std::nullopt;
  const net::Rights given = security::add_public_key(options.list, options.name, options.public_key, rights,
                                                     end_of(options), old_expires_s);
  const std::string server = server_identity(options.list);
  std::fprintf(stderr,
               "telenano-nve: '%s' may %s%s with its public key; on the station: telenano-master run "
               "--identity %s.id --server-key %s\n",
               options.name.c_str(), std::string(net::name(given)).c_str(), until(end_of(options)).c_str(),
               options.name.c_str(), server.c_str());
}

}  // namespace

CLI::App* add_keys_command(CLI::App& app) {
  auto options = std::make_shared<KeysOptions>();
  CLI::App* const command = app.add_subcommand(
      "keys", "Manage who may open encrypted sessions: new, rotate, add, identity, list, revoke");
  command->require_subcommand(1);
  const auto add = [&](const char* name, const char* description) {
    CLI::App* const sub = command->add_subcommand(name, description);
    sub->add_option("--keys", options->list, "List of keys (TOML)")->capture_default_str()->type_name("FILE");
    return sub;
  };
  CLI::App* const fresh =
      add("new", "Create a key: add it to the list and write the key file for the station");
  fresh->add_option("name", options->name, "Name of the station")->required();
  const std::vector<std::string> rights(net::kRightsNames.begin(), net::kRightsNames.end());
  fresh->add_option("--rights", options->rights, "observe | operate | administer")
      ->capture_default_str()
      ->check(CLI::IsMember(rights));
  fresh->add_option("--out", options->out, "Key file for the station (default: NAME.key)")->type_name("FILE");
  const auto add_days = [&](CLI::App* sub) {
    sub->add_option("--days", options->days, "Days until the key expires (default: never)")
        ->type_name("DAYS")
        ->check(CLI::Range(1e-5, 36500.0));
  };
  add_days(fresh);
  fresh->callback([options] { make_key(*options); });

  CLI::App* const rotate =
      add("rotate", "Replace a key by a new one with the same rights; the old key expires after the overlap");
  rotate->add_option("name", options->name, "Name of the key to replace")->required();
  rotate->add_option("--overlap-days", options->overlap_days, "Days during which both keys are valid")
      ->capture_default_str()
      ->type_name("DAYS")
      ->check(CLI::Range(0.0, 365.0));
  add_days(rotate);
  rotate->add_option("--out", options->out, "Key file for the station (default: NEWNAME.key)")
      ->type_name("FILE");
  rotate->callback([options] { rotate_key(*options); });

  CLI::App* const add_public = add(
      "add", "Give a station access by its public key (telenano-master enroll); the server stores no secret");
  add_public->add_option("name", options->name, "Name of the station")->required();
  add_public
      ->add_option("--public", options->public_key,
                   "The station's public key, as printed by telenano-master enroll")
      ->required()
      ->type_name("sha256:HEX");
  add_public
      ->add_option(
          "--rights", options->public_rights,
          "observe | operate | administer (default: the rights that the station already has, else operate)")
      ->check(CLI::IsMember(rights));
  add_public
      ->add_option("--overlap-days", options->public_overlap_days,
                   "Days until the station's earlier public key expires; required if it has one")
      ->type_name("DAYS")
      ->check(CLI::Range(0.0, 365.0));
  add_days(add_public);
  add_public->callback([options] { add_public_key(*options); });

  CLI::App* const identity =
      add("identity",
          "Print this server's public key, which stations pass as --server-key; created if there is none");
  identity->callback([options] { std::printf("%s\n", server_identity(options->list).c_str()); });

  CLI::App* const list = add("list", "Print the list as CSV, without secrets");
  list->callback([options] { std::fputs(security::list_keys(options->list).c_str(), stdout); });

  CLI::App* const revoke =
      add("revoke", "Remove a key or certificate from the list; a running server ends its sessions");
  revoke
      ->add_option(
          "name", options->name,
          "Name of the key, sha256:HEX of a public key, or common name or fingerprint of a certificate")
      ->required();
  revoke->callback([options] {
    security::revoke_key(options->list, options->name);
    std::fprintf(stderr, "telenano-nve: removed '%s' from the list\n", options->name.c_str());
  });
  return command;
}

}  // namespace telenano::app

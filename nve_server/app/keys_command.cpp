#include "telenano/nve_server/app/keys_command.h"

#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "telenano/common/net/rights.h"
#include "telenano/common/security/key_admin.h"

namespace telenano::app {
namespace {

struct KeysOptions {
  std::string list = "keys.toml";
  std::string name;
  std::string rights = "operate";
  std::string out;
};

void make_key(const KeysOptions& options) {
  const std::string out = options.out.empty() ? options.name + ".key" : options.out;
  security::new_key(options.list, options.name, *net::parse_rights(options.rights), out);
  std::fprintf(
      stderr,
      "telenano-nve: key '%s' may %s; bring %s to its station (telenano-master run --key), then remove it "
      "here\n",
      options.name.c_str(), options.rights.c_str(), out.c_str());
}

}  // namespace

CLI::App* add_keys_command(CLI::App& app) {
  auto options = std::make_shared<KeysOptions>();
  CLI::App* const command = app.add_subcommand("keys", "Who may open encrypted sessions: new, list, revoke");
  command->require_subcommand(1);
  const auto add = [&](const char* name, const char* description) {
    CLI::App* const sub = command->add_subcommand(name, description);
    sub->add_option("--keys", options->list, "The list of keys (TOML)")
        ->capture_default_str()
        ->type_name("FILE");
    return sub;
  };
  CLI::App* const fresh = add("new", "Make a key: adds it to the list and writes the station's file");
  fresh->add_option("name", options->name, "Name of the station")->required();
  const std::vector<std::string> rights(net::kRightsNames.begin(), net::kRightsNames.end());
  fresh->add_option("--rights", options->rights, "observe | operate | administer")
      ->capture_default_str()
      ->check(CLI::IsMember(rights));
  fresh->add_option("--out", options->out, "The station's file; left out: NAME.key")->type_name("FILE");
  fresh->callback([options] { make_key(*options); });

  CLI::App* const list = add("list", "Print the list as CSV, without secrets");
  list->callback([options] { std::fputs(security::list_keys(options->list).c_str(), stdout); });

  CLI::App* const revoke =
      add("revoke", "Take a key or certificate off the list; a running server ends its sessions");
  revoke->add_option("name", options->name, "Name of the key, common name or fingerprint of the certificate")
      ->required();
  revoke->callback([options] {
    security::revoke_key(options->list, options->name);
    std::fprintf(stderr, "telenano-nve: '%s' is off the list\n", options->name.c_str());
  });
  return command;
}

}  // namespace telenano::app

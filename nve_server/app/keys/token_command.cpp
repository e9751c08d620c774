#include "telenano/nve_server/app/keys/token_command.h"

#include <CLI/CLI.hpp>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "telenano/common/base/utc_time.h"
#include "telenano/common/net/rights.h"
#include "telenano/common/security/connect_token.h"
#include "telenano/common/security/private_file.h"

namespace telenano::app {
namespace {

struct TokenOptions {
  std::string station;
  std::string issuer;
  std::vector<std::string> servers;
  std::string rights = "operate";
  double minutes = 10;
  std::string out;
};

void make(const TokenOptions& options) {
  using std::chrono::seconds;
  const security::Issuer issuer = security::load_issuer(options.issuer);
  const auto now = std::chrono::floor<seconds>(std::chrono::system_clock::now());
  security::TokenName name;
  name.issuer = issuer.name;
  name.station = options.station;
  name.rights = *net::parse_rights(options.rights);
  name.expires_s =
      now.time_since_epoch().count() + static_cast<std::int64_t>(std::ceil(60 * options.minutes));
  std::string servers;
  for (const std::string& server : options.servers) servers += (servers.empty() ? "" : ",") + server;
  const std::string text = security::token_text(security::make_token(issuer, name, servers));
  if (options.out == "-") {
    std::fputs(text.c_str(), stdout);
    return;
  }
  const std::string out = options.out.empty() ? options.station + ".token" : options.out;
  security::create_private_file(out, text, "--out");
  std::fprintf(
      stderr,
      "telenano-nve: %s lets '%s' begin sessions that %s with %s until %s (telenano-master run --token)\n",
      out.c_str(), options.station.c_str(), options.rights.c_str(), servers.c_str(),
      utc_text(name.expires_s).c_str());
}

}  // namespace

CLI::App* add_token_command(CLI::App& app) {
  auto options = std::make_shared<TokenOptions>();
  CLI::App* const command = app.add_subcommand(
      "token",
      "Create a connect token: a file that gives a station access to some servers for a limited time");
  command->add_option("station", options->station, "Name of the station, or of its operator")->required();
  command->add_option("--issuer", options->issuer, "The issuer's file, from telenano-nve keys issuer")
      ->required()
      ->type_name("FILE");
  command
      ->add_option(
          "--server", options->servers,
          "HOST:PORT of the servers, in the order in which the station tries them; A,B or repeat the "
          "flag")
      ->required()
      ->delimiter(',')
      ->type_name("HOST:PORT");
  const std::vector<std::string> rights(net::kRightsNames.begin(), net::kRightsNames.end());
  command->add_option("--rights", options->rights, "observe | operate | administer")
      ->capture_default_str()
      ->check(CLI::IsMember(rights));
  command
      ->add_option("--minutes", options->minutes,
                   "How long the token can begin sessions; a running session then continues")
      ->capture_default_str()
      ->check(CLI::Range(1.0 / 60, 525600.0));
  command->add_option("--out", options->out, "The token; left out: STATION.token; -: standard output")
      ->type_name("FILE");
  command->footer(
      "This contacts no server. Each server with the issuer in its list of keys accepts the token, "
      "judged by its\nown clock. Revoking the issuer (keys revoke) ends all sessions that its "
      "tokens began.");
  command->callback([options] { make(*options); });
  return command;
}

}  // namespace telenano::app

#include "telenano/master/app/enroll_command.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>

#include "telenano/common/base/error.h"
#include "telenano/common/security/identity_file.h"
#include "telenano/common/security/key_list.h"

namespace telenano::app {
namespace {

struct EnrollOptions {
  std::string name;
  std::string out;
};

/// The line for the server goes to stdout, alone, to be sent or run. A pair that is there already stays.
void enroll(const EnrollOptions& options) {
  if (!security::is_identity(options.name))
    throw UserError("station '" + options.name +
                    "': expected a name of 1 to 64 letters, digits, dots, dashes and underscores");
  const std::string path = options.out.empty() ? options.name + ".id" : options.out;
  std::error_code none;
  const bool there = std::filesystem::exists(path, none);
  const std::string key =
      there ? security::read_identity_name(path, "--out") : security::create_identity(path, "--out");
  std::fprintf(stderr,
               "telenano-master: %s %s; it must never leave this machine. Run this line on the server's "
               "machine, or send it to the server's administrator:\n",
               path.c_str(),
               there ? "already holds this station's key pair" : "holds this station's new key pair");
  std::printf("telenano-nve keys add %s --public %s\n", options.name.c_str(), key.c_str());
}

}  // namespace

void add_enroll_command(CLI::App& app) {
  auto options = std::make_shared<EnrollOptions>();
  CLI::App* const command = app.add_subcommand(
      "enroll", "Make this station's own key pair, and print the line that gives it access to a server");
  command->add_option("name", options->name, "Name by which servers will know this station")->required();
  command->add_option("--out", options->out, "File of the key pair (default: NAME.id)")->type_name("FILE");
  command->callback([options] { enroll(*options); });
}

}  // namespace telenano::app

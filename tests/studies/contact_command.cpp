#include "tests/studies/contact_command.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <string>

#include "telenano/common/base/error.h"
#include "tests/studies/contact_study.h"
#include "tests/studies/parse_list.h"

namespace telenano::studies {
namespace {

struct Arguments {
  std::string law = "md";
  std::string lambda;
  std::string delta;
  std::string direction = "approach";
  bool points = false;
};

}  // namespace

void add_contact_command(CLI::App& app) {
  auto arguments = std::make_shared<Arguments>();
  CLI::App* command = app.add_subcommand(
      "contact",
      "The dimensionless contact law under displacement control, as CSV (force/(pi w R), overlap/u_delta)");
  command->add_option("--law", arguments->law, "Contact law: md (Maugis-Dugdale, exact)")
      ->capture_default_str();
  command->add_option("--lambda", arguments->lambda,
                      "Maugis parameters lambda, separated by commas; each one starts from the beginning");
  command->add_option("--delta", arguments->delta, "Overlaps, separated by commas, visited in this order");
  command
      ->add_option("--direction", arguments->direction,
                   "approach: start far away; retract: start in deep contact")
      ->capture_default_str();
  command->add_flag(
      "--points", arguments->points,
      "Print pull-off load, snap-off overlap, radius and overlap at zero load, and loop energy instead");
  command->callback([arguments, command] {
    ContactOptions options;
    options.law = arguments->law;
    options.points = arguments->points;
    if (arguments->direction != "approach" && arguments->direction != "retract") {
      throw UserError("contact: --direction: '" + arguments->direction +
                      "' is unknown; expected approach or retract");
    }
    options.retract = arguments->direction == "retract";
    if (command->count("--lambda") > 0) options.lambda = parse_list(arguments->lambda, "contact: --lambda");
    if (command->count("--delta") > 0) options.delta = parse_list(arguments->delta, "contact: --delta");
    run_contact(options, stdout);
  });
}

}  // namespace telenano::studies

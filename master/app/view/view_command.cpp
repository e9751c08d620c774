#include "telenano/master/app/view/view_command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <string>

#include "telenano/common/config/print.h"
#include "telenano/master/app/view/recorded_view.h"

namespace telenano::app {

CLI::App* add_view_command(CLI::App& app) {
  struct Asked {
    std::string file;
    ViewOptions view;
  };
  auto asked = std::make_shared<Asked>();
  CLI::App* const command = app.add_subcommand(
      "view", "Play a recording in the station's window; needs neither server nor haptic device");
  command->add_option("FILE", asked->file, "recording")->required();
  add_picture_flags(*command, asked->view, "Seconds of the recording at which --screenshot is taken");
  command->footer(
      "Space plays and pauses, arrows move and change the speed, Page up and Page down go from event to "
      "event; "
      "F1 tells the\nrest. To feel a recording's motion at a server again: telenano-master replay FILE "
      "--view.");
  command->callback([asked] { config::print(stderr, "{}\n", view_recording(asked->file, asked->view)); });
  return command;
}

}  // namespace telenano::app

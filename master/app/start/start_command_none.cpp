// In a build without viewer: the same flags, and what to do about it.
#include "telenano/common/base/error.h"

#include <CLI/CLI.hpp>
#include "telenano/master/app/start/start_command.h"
#include "telenano/master/app/start/start_flags.h"

namespace telenano::app {

CLI::App* add_start_command(CLI::App& app, int&) {
  static StartFlags flags;
  CLI::App* const command = add_start_flags(app, flags);
  command->callback([] {
    throw UserError(
        "this build has no viewer: install libglfw3-dev libimgui-dev libepoxy-dev libgl-dev libegl-dev and "
        "configure with -DTELENANO_VIEWER=ON; run needs none");
  });
  return command;
}

}  // namespace telenano::app

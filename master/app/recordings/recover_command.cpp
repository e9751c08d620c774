#include "telenano/master/app/recordings/recover_command.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "telenano/common/recording/recover.h"

namespace telenano::app {

void add_recover_command(CLI::App& app) {
  CLI::App* command = app.add_subcommand(
      "recover",
      "Repair a recording whose program was killed, so that any HDF5 program can open it (in place)");
  const auto files = std::make_shared<std::vector<std::string>>();
  command->add_option("FILE", *files, "Recordings to repair")->required();
  command->callback([files] {
    bool first = true;
    for (const std::string& file : *files) {
      const recording::Recovered result = recording::recover(file);
      if (first) std::printf("file,rows,events,rows_cut,state\n");
      first = false;
      std::printf("%s,%llu,%llu,%llu,%s\n", file.c_str(), static_cast<unsigned long long>(result.rows),
                  static_cast<unsigned long long>(result.events),
                  static_cast<unsigned long long>(result.rows_cut),
                  result.was_closed ? "was closed already" : "recovered");
      std::fflush(stdout);
    }
  });
}

}  // namespace telenano::app

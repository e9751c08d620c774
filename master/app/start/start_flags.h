#pragma once

#include <string>

namespace CLI {
class App;
}

namespace telenano::app {

/// The flags of `start`: what is chosen when its window opens.
struct StartFlags {
  std::string server;
  std::string key;
  std::string identity;
  std::string server_key;
  std::string server_scene;
  std::string device;
  double text_size = 1;
};

CLI::App* add_start_flags(CLI::App& app, StartFlags& flags);

}  // namespace telenano::app

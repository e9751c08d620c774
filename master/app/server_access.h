#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace telenano::app {

/// Where a server is, and how this station shows it who it is.
struct ServerAccess {
  std::string server = "127.0.0.1:5100";
  std::string key;  ///< the station's key file; or the next three
  std::string certificate;
  std::string certificate_key;
  std::string authority;
  double connect_timeout_s = 3;
};

/// All flags of the above but --server. `access` must outlive the command.
void add_access_flags(CLI::App& command, ServerAccess& access);

}  // namespace telenano::app

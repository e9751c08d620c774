#pragma once

#include "telenano/master/connection/server_access.h"

namespace CLI {
class App;
}

namespace telenano::app {

/// All flags of connection::ServerAccess but --server. `access` must outlive the command.
void add_access_flags(CLI::App& command, connection::ServerAccess& access);

}  // namespace telenano::app

#pragma once

#include <spdlog/spdlog.h>

#include <vector>

#include "telenano/nve_server/app/serve/serve_options.h"
#include "telenano/nve_server/app/serve/serve_workers.h"
#include "telenano/nve_server/server/served_scene.h"

namespace telenano::app {

/// One line of what is served and how, then what a station and the kernel give.
void log_served(spdlog::logger& log, const ServeOptions& options, const Workers& workers,
                const std::vector<server::ServedScene>& scenes, bool one_tip);

/// At the end: what was done, and what was dropped.
void log_stopped(spdlog::logger& log, const Workers& workers, bool secure);

}  // namespace telenano::app

#pragma once

#include "common/metrics/page.h"
#include "common/security/security_counters.h"
#include "nve_server/server/server_loop.h"

namespace telenano::app {

/// What a scrape of the server is answered with. `channels` may be null: a server in the clear. Reads what
/// the loop has published, no more.
void write_metrics(const server::LoopStatus& status, const security::SecurityCounters* channels,
                   metrics::Page& page);

}  // namespace telenano::app

#pragma once

#include <vector>

#include "telenano/common/metrics/page.h"
#include "telenano/common/security/dtls_server.h"
#include "telenano/nve_server/server/server_loop.h"

namespace telenano::app {

/// What a scrape of the server is answered with: the sums of all workers, and each one's sessions. `channels`
/// is empty for a server in the clear. Reads what the loops have published, no more.
void write_metrics(const std::vector<const server::LoopStatus*>& workers,
                   const std::vector<security::DtlsServer*>& channels, metrics::Page& page);

}  // namespace telenano::app

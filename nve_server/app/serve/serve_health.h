#pragma once

#include <atomic>
#include <cstdint>
#include <vector>

#include "telenano/common/metrics/text_page.h"
#include "telenano/common/rt/clock.h"
#include "telenano/nve_server/app/serve/server_signals.h"
#include "telenano/nve_server/server/server_loop.h"

namespace telenano::app {

/// What a server knows of itself that decides whether it is alive and ready.
struct HealthFacts {
  /// Each loop's last turn; LoopStatus::kNever before its first.
  std::vector<std::int64_t> turned_ns;
  std::int64_t now_ns = 0;
  std::uint64_t sessions = 0;  ///< active, of all loops
  std::uint64_t max_sessions = 0;
  bool stopping = false;  ///< it was told to end

  /// A loop that has not turned for so long hangs: the service's WatchdogSec.
  static constexpr std::int64_t kHangsNs = 3'000'000'000;
};

/// /healthz: 200 "ok" while all loops turn; 503 "starting" before they do, "hung" when one does not any more:
/// then nothing but a restart helps.
metrics::TextAnswer liveness(const HealthFacts& facts);

/// /readyz: 200 "ready" if a new station would get a session; else 503 and why not, one word: starting, hung,
/// stopping, full.
metrics::TextAnswer readiness(const HealthFacts& facts);

/// Both pages of a running server. Everything referred to must outlive their exporter.
std::vector<metrics::TextPage> health_pages(std::vector<const server::LoopStatus*> loops,
                                            std::uint64_t max_sessions, const ServerSignals& signals,
                                            const rt::Clock& clock);

}  // namespace telenano::app

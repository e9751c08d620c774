#include "telenano/nve_server/app/serve/serve_health.h"

#include <algorithm>
#include <utility>

namespace telenano::app {
namespace {

metrics::TextAnswer no(const char* why) {
  return {503, why};
}

}  // namespace

metrics::TextAnswer liveness(const HealthFacts& facts) {
  if (std::find(facts.turned_ns.begin(), facts.turned_ns.end(), server::LoopStatus::kNever) !=
      facts.turned_ns.end())
    return no("starting");
  for (const std::int64_t turned_ns : facts.turned_ns)
    if (facts.now_ns - turned_ns > HealthFacts::kHangsNs) return no("hung");
  return {200, "ok"};
}

metrics::TextAnswer readiness(const HealthFacts& facts) {
  if (facts.stopping) return no("stopping");
  if (metrics::TextAnswer alive = liveness(facts); alive.status != 200) return alive;
  if (facts.sessions >= facts.max_sessions) return no("full");
  return {200, "ready"};
}

std::vector<metrics::TextPage> health_pages(std::vector<const server::LoopStatus*> loops,
                                            std::uint64_t max_sessions, const ServerSignals& signals,
                                            const rt::Clock& clock) {
  const auto facts = [loops = std::move(loops), max_sessions, &signals, &clock] {
    constexpr auto kRelaxed = std::memory_order_relaxed;
    HealthFacts now;
    for (const server::LoopStatus* const loop : loops) {
      now.turned_ns.push_back(loop->turned_ns.load(kRelaxed));
      now.sessions += loop->sessions.load(kRelaxed);
    }
    now.now_ns = clock.now_ns();
    now.max_sessions = max_sessions;
    now.stopping = signals.stop.load(kRelaxed);
    return now;
  };
  return {{"/healthz", [facts] { return liveness(facts()); }},
          {"/readyz", [facts] { return readiness(facts()); }}};
}

}  // namespace telenano::app

// What /healthz and /readyz say of a server, from the facts alone.
#include <gtest/gtest.h>

#include "telenano/nve_server/app/serve/serve_health.h"

namespace telenano::app {
namespace {

constexpr std::int64_t kSecondNs = 1'000'000'000;

HealthFacts serving() {
  HealthFacts facts;
  facts.now_ns = 100 * kSecondNs;
  facts.turned_ns = {facts.now_ns - 50'000'000, facts.now_ns - 1'000'000};
  facts.sessions = 3;
  facts.max_sessions = 64;
  return facts;
}

void expect(const metrics::TextAnswer& answer, int status, const char* text) {
  EXPECT_EQ(answer.status, status);
  EXPECT_EQ(answer.text, text);
}

TEST(Health, AServerThatServesIsAliveAndReady) {
  expect(liveness(serving()), 200, "ok");
  expect(readiness(serving()), 200, "ready");
}

TEST(Health, BeforeTheFirstTurnOfEachLoopItStarts) {
  HealthFacts facts = serving();
  facts.turned_ns[1] = server::LoopStatus::kNever;
  expect(liveness(facts), 503, "starting");
  expect(readiness(facts), 503, "starting");
}

TEST(Health, OneLoopOfSeveralThatHangsIsEnough) {
  HealthFacts facts = serving();
  facts.turned_ns[0] = facts.now_ns - HealthFacts::kHangsNs;
  expect(liveness(facts), 200, "ok");
  --facts.turned_ns[0];
  expect(liveness(facts), 503, "hung");
  expect(readiness(facts), 503, "hung");
}

TEST(Health, AFullServerIsAliveAndNotReady) {
  HealthFacts facts = serving();
  facts.sessions = facts.max_sessions;
  expect(liveness(facts), 200, "ok");
  expect(readiness(facts), 503, "full");
}

TEST(Health, OneThatWasToldToEndIsNotReady) {
  HealthFacts facts = serving();
  facts.stopping = true;
  expect(liveness(facts), 200, "ok");
  expect(readiness(facts), 503, "stopping");
}

}  // namespace
}  // namespace telenano::app

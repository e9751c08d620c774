// A scene fetched through a session, in virtual time: loss, resume, rights, and what a hostile peer tries.
#include "telenano/common/link/scene_fetch.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "telenano/common/link/rate_control.h"
#include "telenano/master/loop/session_tender.h"
#include "virtual_session.h"

namespace telenano::server {
namespace {

using link::DropCause;
using link::SceneFetch;

constexpr std::int64_t kMs = 1'000'000;

/// The bundle of a scan of 256 × 256 heights has 262 144 bytes of them and some thousand of text.
std::shared_ptr<const SceneToFetch> bundle_of(std::uint32_t bytes, std::uint64_t name = 0x1234567890abcdef) {
  auto scene = std::make_shared<SceneToFetch>();
  Random random(name);
  for (std::uint32_t i = 0; i < bytes; ++i) scene->bytes += static_cast<char>(random.bits());
  scene->offer = {{name, 2, 3, 4}, bytes, 99};
  return scene;
}

ServedScene fetchable(std::shared_ptr<const SceneToFetch> bundle) {
  ServedScene scene = spring_scene();
  scene.to_fetch = std::move(bundle);
  return scene;
}

net::SimPath path(double delay_ms, double loss) {
  net::SimPath p;
  p.delay_ns = static_cast<std::int64_t>(delay_ms * 1e6);
  p.loss = loss;
  return p;
}

/// A station that fetches beside its commands, as its loop does: at most two requests a tick.
struct Fetching {
  Fetching(Server& server, const net::SimPath& way, std::uint64_t seed,
           std::uint64_t features = link::kKnownFeatures)
      : session(&server, client(features), way, way, seed) {
    session.on_event = [this](link::ClientEvent event) {
      if (event == link::ClientEvent::kWelcome) {
        if (session.client.epoch_changed()) rate.reset();
        fetch.offer(session.client.welcome().scene, session.link.now_ns());
      }
      if (event == link::ClientEvent::kReply) {
        ++replies;
        const auto& stats = session.client.stats();
        rate.on_reply(session.link.now_ns(), stats.samples() != rtt_samples ? stats.rtt_last_ns() : -1,
                      {session.client.reply().command_sequence, session.client.reply().sequence, 0});
        rtt_samples = stats.samples();
      }
      if (event != link::ClientEvent::kSceneChunk) return;
      const link::SceneChunk& chunk = session.client.incoming().scene_chunk;
      fetch.take(chunk.chunk, std::span(chunk.data).first(chunk.size), session.link.now_ns());
    };
    session.before_end_of_tick = [this] {
      const bool established = session.client.state() == link::ClientState::kEstablished;
      fetch.set_up(established, session.now_ns);
      rate.update(session.now_ns);
      if (established) rate.sent(session.now_ns);
      fetch.set_link_most(rate.bulk_per_s());
      for (int i = 0; i < 2; ++i) {
        const auto chunk = fetch.next(session.now_ns);
        if (!chunk) break;
        const std::size_t n = session.client.make_scene_request(*chunk, session.buffer);
        rate.bulk_sent(session.now_ns);
        if (n > 0) session.link.a().send({session.buffer.data(), n}, {});
      }
    };
    session.client.start(0);
  }
  static link::ClientConfig client(std::uint64_t features) {
    link::ClientConfig config;
    config.feature_bits = features;
    return config;
  }
  /// Ticks until it is over, at most `ms`; how many.
  int run(int ms) {
    for (int i = 0; i < ms; ++i) {
      if (fetch.state() == SceneFetch::State::kDone) return i;
      session.tick();
    }
    return ms;
  }
  bool has(const SceneToFetch& scene) const {
    return std::equal(fetch.bytes().begin(), fetch.bytes().end(), scene.bytes.begin(), scene.bytes.end(),
                      [](std::uint8_t a, char b) { return a == static_cast<std::uint8_t>(b); });
  }

  VirtualSession session;
  SceneFetch fetch;
  std::uint64_t replies = 0;
  link::RateControl rate;  ///< paces it, as in the loop
  std::uint64_t rtt_samples = 0;
};

// What was asked for: 20 ms of round trip and 2 % of loss either way, handshake included.
TEST(FetchScene, AScanOf256By256IsHereWithinASecond) {
  const auto bundle = bundle_of(262'144 + 3000);
  int slowest_ms = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Server server(test_config(), fetchable(bundle));
    Fetching f(server, path(10, 0.02), seed);
    const int took_ms = f.run(3000);
    EXPECT_LT(took_ms, 1000) << "seed " << seed;
    slowest_ms = std::max(slowest_ms, took_ms);
    EXPECT_EQ(f.fetch.state(), SceneFetch::State::kDone);
    EXPECT_TRUE(f.has(*bundle));
  }
  std::printf("slowest of 20: %d ms\n", slowest_ms);
}

TEST(FetchScene, CommandsAndRepliesGoOnAsWithoutIt) {
  const auto run = [](std::shared_ptr<const SceneToFetch> bundle) {
    Server server(test_config(), fetchable(std::move(bundle)));
    Fetching f(server, path(10, 0), 3);
    f.run(600);
    f.session.ticks(600 - static_cast<int>(f.session.now_ns / kMs));
    return std::pair(f.replies, f.session.client.stats().rtt_ns());
  };
  const auto with = run(bundle_of(262'144)), without = run(nullptr);
  EXPECT_EQ(with.first, without.first);
  EXPECT_EQ(with.second, without.second);
}

TEST(FetchScene, HeavyLossOnlyMakesItSlower) {
  const auto bundle = bundle_of(50'000);
  for (const double loss : {0.1, 0.3}) {
    Server server(test_config(), fetchable(bundle));
    Fetching f(server, path(50, loss), 5);
    f.run(60'000);
    EXPECT_EQ(f.fetch.state(), SceneFetch::State::kDone) << loss;
    EXPECT_TRUE(f.has(*bundle));
  }
}

// After an outage the session is resumed under another id; what is here is not asked for again.
TEST(FetchScene, GoesOnAfterAnOutageWhereItWas) {
  const auto bundle = bundle_of(262'144);
  Server server(test_config(), fetchable(bundle));
  Fetching f(server, path(10, 0), 7);
  f.run(300);
  const std::uint32_t had = f.fetch.have();
  ASSERT_GT(had, 50u);
  ASSERT_LT(had, bundle->offer.chunks());
  const std::uint64_t sessions = f.session.client.sessions();
  f.session.link.path_a_to_b().loss = f.session.link.path_b_to_a().loss = 1;
  f.session.ticks(3000);
  f.session.link.path_a_to_b().loss = f.session.link.path_b_to_a().loss = 0;
  f.run(5000);
  EXPECT_GT(f.session.client.sessions(), sessions);
  EXPECT_EQ(f.fetch.state(), SceneFetch::State::kDone);
  EXPECT_TRUE(f.has(*bundle));
  // Asked for again is what was under way when the outage came, at most a fifth of a second's requests, and
  // what was asked for before the station knew of it.
  EXPECT_LT(f.fetch.requests(), bundle->offer.chunks() + 300u);
}

TEST(FetchScene, GoesOnAtAnotherServerOfTheSameSceneAndBeginsAnewForAnotherScene) {
  const auto bundle = bundle_of(100'000), other = bundle_of(90'000, 77);
  ServerConfig second = test_config();
  second.secret = {9, 9};
  Server same(second, fetchable(bundle)), changed(second, fetchable(other));
  for (Server* next : {&same, &changed}) {
    Server one(test_config(), fetchable(bundle));  // each time: its budget knows no time that runs backwards
    Fetching f(one, path(5, 0), 8);
    f.run(200);
    const std::uint32_t had = f.fetch.have();
    ASSERT_GT(had, 20u);
    f.session.server = next;
    f.run(5000);
    const SceneToFetch& wanted = next == &same ? *bundle : *other;
    ASSERT_EQ(f.fetch.state(), SceneFetch::State::kDone);
    EXPECT_TRUE(f.has(wanted));
    EXPECT_EQ(next->counters().scene_chunks < bundle->offer.chunks() - had / 2, next == &same);
  }
}

TEST(FetchScene, IsOfferedToThoseWhoAskForItOnly) {
  const auto bundle = bundle_of(1000);
  {
    Server server(test_config(), fetchable(bundle));
    Fetching f(server, path(1, 0), 1, link::kKnownFeatures & ~std::uint64_t{link::kFeatureScene});
    f.session.ticks(100);
    EXPECT_TRUE(f.session.client.has_session());
    EXPECT_TRUE(f.session.client.welcome().scene.empty());
    EXPECT_EQ(f.session.client.make_scene_request(0, f.session.buffer), 0u);
  }
  Server without(test_config(), fetchable(nullptr));
  Fetching f(without, path(1, 0), 1);
  f.session.ticks(100);
  EXPECT_TRUE(f.session.client.has_session());
  EXPECT_EQ(f.session.client.features() & link::kFeatureScene, 0u);
  EXPECT_EQ(f.fetch.state(), SceneFetch::State::kIdle);
}

/// A request by hand, and under which cause it was dropped (kNone: it was answered).
struct ByHand {
  explicit ByHand(std::uint64_t features = link::kKnownFeatures)
      : server(test_config(), fetchable(bundle)), f(server, path(1, 0), 1, features) {
    f.session.before_end_of_tick = nullptr;
    f.session.ticks(50);
  }
  DropCause ask(link::SceneRequest request, const net::Address& from, const net::Standing& standing = {}) {
    const auto before = server.drops();
    const std::size_t n = codec.encode(request, buffer);
    const std::size_t answered =
        server.on_datagram({buffer.data(), n}, from, f.session.now_ns, answer, nullptr, standing);
    for (std::size_t i = 1; i < link::kDropCauseCount; ++i) {
      const auto cause = static_cast<DropCause>(i);
      if (server.drops()[cause] != before[cause]) return answered == 0 ? cause : DropCause::kCount;
    }
    return answered > 0 ? DropCause::kNone : DropCause::kCount;
  }
  link::SceneRequest good() { return {f.session.client.welcome().session_id, bundle->offer.name(), 0}; }

  std::shared_ptr<const SceneToFetch> bundle = bundle_of(1000);
  Server server;
  Fetching f;
  link::Codec codec;
  std::array<std::uint8_t, link::kMaxDatagramBytes> buffer{}, answer{};
};

TEST(FetchScene, WhatIsAskedForByOthersIsNotAnswered) {
  ByHand b;
  const net::Address own = b.f.session.link.address_a();
  EXPECT_EQ(b.ask(b.good(), own), DropCause::kNone);
  net::Address elsewhere = own;
  ++elsewhere.port;
  EXPECT_EQ(b.ask(b.good(), elsewhere), DropCause::kUnauthenticated);
  net::Standing other_key;
  other_key.identity = 5;
  EXPECT_EQ(b.ask(b.good(), own, other_key), DropCause::kUnauthenticated);
  link::SceneRequest request = b.good();
  ++request.session_id;
  EXPECT_NE(b.ask(request, own), DropCause::kNone);
  request = b.good();
  ++request.bundle;
  EXPECT_EQ(b.ask(request, own), DropCause::kOutOfRange);
  for (const std::uint32_t chunk : {3u, 4u, UINT32_MAX}) {
    request = b.good();
    request.chunk = chunk;  // 1000 bytes are three
    EXPECT_EQ(b.ask(request, own), DropCause::kOutOfRange);
  }
  // A session that has been silent, and one that is over, get nothing.
  b.server.poll(b.f.session.now_ns += 5000 * kMs);
  EXPECT_EQ(b.ask(b.good(), own), DropCause::kUnexpected);
  ByHand without(link::kKnownFeatures & ~std::uint64_t{link::kFeatureScene});
  EXPECT_EQ(without.ask(without.good(), without.f.session.link.address_a()), DropCause::kUnexpected);
}

// 64 at once and 2000 a second, whatever is asked for; and asking does not keep a session awake.
TEST(FetchScene, IsAnsweredWithinABudget) {
  ByHand b;
  const net::Address own = b.f.session.link.address_a();
  int answered = 0;
  for (int i = 0; i < 10'000; ++i) answered += b.ask(b.good(), own) == DropCause::kNone ? 1 : 0;
  EXPECT_EQ(answered, 64);
  b.f.session.now_ns += 100 * kMs;
  for (int i = 0; i < 10'000; ++i) answered += b.ask(b.good(), own) == DropCause::kNone ? 1 : 0;
  EXPECT_EQ(answered, 128);
  EXPECT_EQ(b.server.drops()[DropCause::kRateLimited], 20'000u - 128u);
  for (int i = 0; i < 40; ++i) {
    b.f.session.now_ns += 100 * kMs;
    b.ask(b.good(), own);
    b.server.poll(b.f.session.now_ns);
  }
  EXPECT_EQ(b.server.sessions().active(), 0u);
}

// A server that sends what was not asked for, twice, too long, of another scene or without end: the station
// takes each wanted piece once, and nothing grows.
TEST(FetchScene, AStationTakesOnlyWhatItAskedFor) {
  SceneFetch fetch;
  const link::SceneOffer offer{{1, 2, 3, 4}, 1000, 5};
  fetch.offer(offer, 0);
  fetch.set_up(true, 0);
  const std::vector<std::uint8_t> whole(link::kSceneChunkBytes, 7),
      last(1000 - 2 * link::kSceneChunkBytes, 8);
  EXPECT_FALSE(fetch.take(0, whole, 1)) << "not asked for";
  std::int64_t now_ns = 0;
  while (fetch.requests() < 3) fetch.next(now_ns += kMs);
  EXPECT_FALSE(fetch.take(0, last, now_ns)) << "too short";
  EXPECT_FALSE(fetch.take(2, whole, now_ns)) << "too long";
  EXPECT_FALSE(fetch.take(3, last, now_ns)) << "beyond the end";
  EXPECT_FALSE(fetch.take(UINT32_MAX, last, now_ns));
  EXPECT_TRUE(fetch.take(0, whole, now_ns));
  for (int i = 0; i < 1000; ++i) EXPECT_FALSE(fetch.take(0, whole, now_ns)) << "twice";
  EXPECT_TRUE(fetch.take(2, last, now_ns));
  EXPECT_EQ(fetch.state(), SceneFetch::State::kFetching);
  EXPECT_TRUE(fetch.take(1, whole, now_ns));
  EXPECT_EQ(fetch.state(), SceneFetch::State::kDone);
  EXPECT_FALSE(fetch.take(1, whole, now_ns));
}

TEST(FetchScene, AHugeOneIsNotBegunAndASilentOneIsGivenUp) {
  SceneFetch fetch;
  fetch.offer({{1, 2, 3, 4}, UINT32_MAX, 0}, 0);
  EXPECT_EQ(fetch.state(), SceneFetch::State::kTooLarge);
  EXPECT_TRUE(fetch.bytes().empty());
  EXPECT_FALSE(fetch.next(kMs));
  const link::SceneOffer offer{{1, 2, 3, 4}, 1000, 5};
  fetch.offer(offer, 0);
  fetch.set_up(true, 0);
  std::int64_t now_ns = 0;
  while (fetch.state() == SceneFetch::State::kFetching && now_ns < 100'000 * kMs)
    fetch.next(now_ns += 10 * kMs);
  EXPECT_EQ(fetch.state(), SceneFetch::State::kGivenUp);
  EXPECT_GT(now_ns, 19'000 * kMs);
  EXPECT_LT(now_ns, 21'000 * kMs);
  EXPECT_LT(fetch.requests(), 600u) << "20 a second to a server that does not answer";
}

TEST(FetchScene, AStationDropsPiecesThatAreNoneOfItsScene) {
  ByHand b;
  auto& client = b.f.session.client;
  link::SceneChunk chunk;
  chunk.session_id = client.welcome().session_id;
  chunk.bundle = b.bundle->offer.name();
  chunk.size = link::kSceneChunkBytes;
  const auto hear = [&](const link::SceneChunk& c) {
    const std::size_t n = b.codec.encode(c, b.buffer);
    const auto before = client.drops();
    const auto event = client.on_datagram({b.buffer.data(), n}, b.f.session.now_ns);
    for (std::size_t i = 1; i < link::kDropCauseCount; ++i) {
      const auto cause = static_cast<DropCause>(i);
      if (client.drops()[cause] != before[cause]) return cause;
    }
    return event == link::ClientEvent::kSceneChunk ? DropCause::kNone : DropCause::kCount;
  };
  EXPECT_EQ(hear(chunk), DropCause::kNone);
  link::SceneChunk other = chunk;
  ++other.session_id;
  EXPECT_EQ(hear(other), DropCause::kUnknownSession);
  other = chunk;
  ++other.bundle;
  EXPECT_EQ(hear(other), DropCause::kOutOfRange);
  other = chunk;
  other.chunk = 3;
  EXPECT_EQ(hear(other), DropCause::kOutOfRange);
  other = chunk;
  other.size = 10;
  EXPECT_EQ(hear(other), DropCause::kOutOfRange);
}

/// A session without a loop, tended while its scene is fetched, as before a run begins.
struct Tended {
  Tended(Server& server_in, const net::SimPath& way) : server(server_in), link(way, way, 5) {
    client.start(0);
    std::array<std::uint8_t, link::kMaxDatagramBytes> out{};
    while (client.state() != link::ClientState::kEstablished) {
      serve_until(now_ns += kMs);
      net::Received received;
      while (link.a().receive(buffer, received)) client.on_datagram({buffer.data(), received.size}, now_ns);
      if (const std::size_t n = client.poll(now_ns, out)) link.a().send({out.data(), n}, {});
    }
    tender.emplace(client, link.a(), link.address_b(), pipe, clock, 1000.0);
    tender->on_event = [this](link::ClientEvent event) {
      if (event == link::ClientEvent::kReply)
        last_rtt_ms = 1e-6 * static_cast<double>(client.stats().rtt_last_ns());
    };
    fetch.offer(client.welcome().scene, now_ns);
  }
  void serve_until(std::int64_t to_ns) {
    net::Received received;
    while (link.next_arrival_ns() <= to_ns) {
      const std::int64_t before_ns = link.now_ns();
      link.advance_to(link.next_arrival_ns());
      bool any = false;
      while (link.b().receive(buffer, received)) {
        any = true;
        const std::size_t n =
            server.on_datagram({buffer.data(), received.size}, received.from, link.now_ns(), answer);
        if (n > 0) link.b().send({answer.data(), n}, received.from);
      }
      if (!any && link.now_ns() == before_ns) break;  // only the station's are left
    }
    link.advance_to(to_ns);
  }
  /// A millisecond: the keeper's turn, then the tender's.
  void turn(bool paced) {
    serve_until(now_ns += kMs);
    clock.advance_to(now_ns);
    loop::ScenePiece piece;
    while (pipe.pieces.pop(piece)) fetch.take(piece.chunk, std::span(piece.data).first(piece.size), now_ns);
    fetch.set_up(true, now_ns);
    fetch.set_link_most(paced ? pipe.link_most_per_s.load() : link::RateControl::kBulkMost_per_s);
    while (const auto chunk = fetch.next(now_ns)) pipe.requests.push({fetch.scene().name(), *chunk});
    tender->turn();
  }

  Server& server;
  net::SimLink link;
  rt::VirtualClock clock;
  link::ClientSession client{link::ClientConfig{}};
  loop::ScenePipe pipe;
  SceneFetch fetch;
  std::optional<loop::SessionTender> tender;
  std::int64_t now_ns = 0;
  double last_rtt_ms = 0;
  std::array<std::uint8_t, link::kMaxDatagramBytes + 1> buffer{};
  std::array<std::uint8_t, link::kMaxDatagramBytes> answer{};
};

// Before there is a loop as within it: a thin link has no queue, a wide one is as fast as ever.
TEST(FetchScene, BeforeTheLoopItLeavesAThinLinkNoQueueEither) {
  const auto bundle = bundle_of(600'000);
  int took_ms[2] = {0, 0};
  for (const bool paced : {false, true}) {
    Server server(test_config(), fetchable(bundle));
    net::SimPath thin = path(2, 0);
    thin.rate_bit_s = 1e6;
    thin.queue_bytes = 65536;
    Tended t(server, thin);
    double worst_ms = 0;
    int ms = 0;
    for (; ms < 40'000 && t.fetch.state() != SceneFetch::State::kDone; ++ms) {
      t.turn(paced);
      if (ms >= 2000) worst_ms = std::max(worst_ms, t.last_rtt_ms);
    }
    std::printf("600 kB over 1 Mbit/s, %s: %d ms, longest round trip after 2 s %.1f ms\n",
                paced ? "paced" : "not paced", ms, worst_ms);
    took_ms[paced] = ms;
    if (!paced) {
      EXPECT_GT(worst_ms, 200) << "what is mended";
      continue;
    }
    EXPECT_EQ(t.fetch.state(), SceneFetch::State::kDone);
    EXPECT_LE(worst_ms, 30);
    EXPECT_LT(took_ms[1], 1.1 * took_ms[0]) << "it takes what the link has";
    EXPECT_EQ(t.client.state(), link::ClientState::kEstablished);
  }
  Server server(test_config(), fetchable(bundle_of(265'000)));
  Tended wide(server, path(10, 0));
  int ms = 0;
  for (; ms < 2000 && wide.fetch.state() != SceneFetch::State::kDone; ++ms) wide.turn(true);
  std::printf("265 kB over 20 ms of round trip: %d ms\n", ms);
  EXPECT_LT(ms, 1200);
  // Where nothing is fetched, a command every 20 ms is enough.
  const std::uint64_t before = wide.client.commands_sent();
  for (int i = 0; i < 3000; ++i) wide.turn(true);
  EXPECT_LT(wide.client.commands_sent() - before, 1000u + 2000 / 20 + 5)
      << "a second of them belongs to the fetch";
}

}  // namespace
}  // namespace telenano::server

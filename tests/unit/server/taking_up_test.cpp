// Sessions of a server that is gone, and a server that has not places for all of them: who finds none must find the
// session where it waits, at the next server.
#include <gtest/gtest.h>

#include <map>
#include <memory>
#include <vector>

#include "telenano/common/link/client_session.h"
#include "virtual_session.h"

namespace telenano::server {
namespace {

using link::ClientEvent;
using link::ClientState;

constexpr std::int64_t kMs = 1'000'000;
constexpr std::size_t kPlaces = 4, kStations = 10;

net::Address address_of(std::size_t k) {
  net::Address address;
  address.ip[15] = 1;
  address.port = static_cast<std::uint16_t>(1000 + k);
  return address;
}

/// The keeper's end of the mail, by hand: sessions with the tokens 1 … kStations wait for their stations.
class Waiting {
 public:
  Waiting(WorkerMail& mail, CheckpointQueue& queue) : mail_(mail), queue_(queue) {
    for (std::uint64_t token = 1; token <= kStations; ++token) waits_[token] = true;
  }
  /// Answers so many questions of `worker`.
  void answer(int most = 1 << 30) {
    HandoffMessage question;
    for (int i = 0; i < most && mail_.fetch(mail_.workers(), question); ++i) {
      HandoffMessage message;
      message.kind = HandoffMessage::Kind::kNotHere;
      message.from = static_cast<std::uint32_t>(mail_.workers());
      message.ticket = question.ticket;
      if (waits_[question.token]) {
        waits_[question.token] = false;
        ++taken;
        message.kind = HandoffMessage::Kind::kState;
        message.state = new SessionState;
        message.state->session.state = link::SlotState::kSilent;
        message.state->session.resume_token = question.token;
        message.state->session.epoch = static_cast<std::uint32_t>(70 + question.token);
        message.state->session.rate_hz = 1000;
        message.state->session.used = true;
        message.state->tip.slave = std::make_unique<SpringSlave>();
        message.state->tip.at_rest = false;
        message.state->record.restored = true;
      }
      ASSERT_TRUE(mail_.post(question.from, message));
    }
    CheckpointNote note;
    while (queue_.fetch(note)) {
      if (note.kind == CheckpointNote::Kind::kGiveBack) {
        waits_[note.token] = true;
        ++given_back;
      }
      if (note.kind == CheckpointNote::Kind::kState) queue_.give_back(note.buffer);
      queue_.done(note);
    }
  }
  bool waits(std::uint64_t token) { return waits_[token]; }
  int taken = 0, given_back = 0;

 private:
  WorkerMail& mail_;
  CheckpointQueue& queue_;
  std::map<std::uint64_t, bool> waits_;
};

struct Stations {
  explicit Stations(Server& of) : server(of) {
    for (std::size_t k = 0; k < kStations; ++k) {
      link::ClientConfig config;
      config.nonce_seed = k + 1;
      config.resume_token = k + 1;
      clients.push_back(std::make_unique<link::ClientSession>(config));
      clients.back()->start(now_ns);
    }
  }
  void hear(std::size_t k, std::size_t bytes) {
    if (bytes > 0 && clients[k]->on_datagram({out.data(), bytes}, now_ns) == ClientEvent::kRefused)
      refused[k] = true;
  }
  void look() {
    server.exchange_mail();
    net::Address to;
    while (const std::size_t n = server.next_answer(now_ns, out, to)) hear(to.port - 1000u, n);
  }
  void say() {
    now_ns += 50 * kMs;
    server.poll(now_ns);
    net::Standing proven;
    proven.address_proven = true;
    for (std::size_t k = 0; k < kStations; ++k) {
      if (refused[k]) continue;  // it asks the next server
      if (const std::size_t n = clients[k]->poll(now_ns, in))
        hear(k, server.on_datagram({in.data(), n}, address_of(k), now_ns, out, nullptr, proven));
    }
  }
  Server& server;
  std::vector<std::unique_ptr<link::ClientSession>> clients;
  std::array<bool, kStations> refused{};
  std::int64_t now_ns = 1'000'000'000;
  std::array<std::uint8_t, link::kMaxDatagramBytes> in{}, out{};
};

ServerConfig config_with(WorkerMail& mail, CheckpointQueue& queue) {
  ServerConfig config = test_config();
  config.table.capacity = kPlaces;
  config.openings_per_s = 1e6;
  config.mail = &mail;
  config.checkpoints = &queue;
  return config;
}

/// The keeper is slow: all have asked before it answers the first, or it answers one at a time.
TEST(TakingUp, AsManyAsThereArePlacesAndTheOthersAreLeftWhereTheyWait) {
  for (const int at_a_time : {1, 3, 1 << 30}) {
    WorkerMail mail(1, true);
    CheckpointQueue queue(4096, mail.bell());
    Waiting waiting(mail, queue);
    Server server(config_with(mail, queue), spring_scene());
    Stations stations(server);
    for (int turn = 0; turn < 100; ++turn) {
      stations.say();
      waiting.answer(at_a_time);
      stations.look();
    }
    std::size_t here = 0;
    for (std::size_t k = 0; k < kStations; ++k) {
      const bool has = stations.clients[k]->state() == ClientState::kEstablished;
      here += has ? 1 : 0;
      EXPECT_NE(has, stations.refused[k]) << k;
      if (has) {
        EXPECT_EQ(stations.clients[k]->welcome().epoch, 71 + k) << "its own session";
      } else {
        EXPECT_TRUE(waiting.waits(k + 1)) << k << ": the next server would not find it";
      }
    }
    EXPECT_EQ(here, kPlaces);
    EXPECT_EQ(waiting.taken, static_cast<int>(kPlaces)) << "none is taken for nothing";
    EXPECT_EQ(waiting.given_back, 0);
  }
}

/// Other workers have the places under the cap: what was taken up goes back, so that another server may have it.
TEST(TakingUp, ForNothingItGoesBack) {
  WorkerMail mail(1, true);
  CheckpointQueue queue(4096, mail.bell());
  Waiting waiting(mail, queue);
  SessionCap cap(kPlaces);
  ServerConfig config = config_with(mail, queue);
  config.cap = &cap;
  Server server(config, spring_scene());
  while (cap.take()) {
  }
  Stations stations(server);
  for (int turn = 0; turn < 100; ++turn) {
    stations.say();
    waiting.answer();
    stations.look();
  }
  waiting.answer();
  for (std::size_t k = 0; k < kStations; ++k) {
    EXPECT_TRUE(stations.refused[k]) << k;
    EXPECT_TRUE(waiting.waits(k + 1)) << k;
  }
  EXPECT_EQ(server.sessions().occupied(), 0u);
  EXPECT_EQ(waiting.given_back, waiting.taken);
}

}  // namespace
}  // namespace telenano::server

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <queue>
#include <string>
#include <tuple>
#include <vector>

#include "telenano/common/base/random.h"
#include "telenano/common/link/rate_control.h"

namespace telenano::link {
namespace {

constexpr std::int64_t kMs = 1'000'000;
// On the wire: the longest Command 207 bytes and a Reply of 226 without what most servers do not send, 28 of
// IP and UDP, 37 of DTLS; a repeated command 64.
constexpr double kCommandBytes = 207 + 28 + 37;
constexpr double kReplyBytes = 226 + 28 + 37;
constexpr double kRepeatBytes = 64;
// A snapshot's piece and its request, with the same headers.
constexpr double kPieceBytes = 448 + 60 + 28 + 37;
constexpr double kAskBytes = 40 + 28 + 37;

struct Way {
  double kbit_s = 0;  ///< 0: no limit
  double queue_kib = 64;
  double rtt_ms = 2;       ///< without a queue
  double loss = 0;         ///< each way, at chance
  double jitter_ms = 0;    ///< exponential, each way
  bool any_order = false;  ///< else what is late delays what is behind it
};

/// One direction: first in, first out. The oracle: what a queue is, in six lines.
struct Pipe {
  double ns_per_byte = 0;
  double queue_bytes = 0;
  double free_ns = 0;
  double out_ns = 0;
  std::uint64_t dropped = 0;

  /// When the last bit is through; below 0: no room.
  double send(double now_ns, double bytes) {
    if (ns_per_byte <= 0) return now_ns;
    const double begin_ns = std::max(now_ns, free_ns);
    if ((begin_ns - now_ns) / ns_per_byte + bytes > queue_bytes) {
      ++dropped;
      return -1;
    }
    return free_ns = begin_ns + bytes * ns_per_byte;
  }
};

/// Stations with a controller each, on one bottleneck, in virtual time.
class World {
 public:
  struct Flow {
    RateControl control;
    double begin_ns = 0;
    double end_ns = 1e18;
    double stall_every_ns = 0;  ///< the machine stands still for stall_ns
    double stall_ns = 0;
    std::uint64_t command = 0;
    std::uint64_t sent = 0;
    std::uint64_t got = 0;
    std::uint64_t leaves_out = 0;  ///< so many replies of each row of so many and one
    bool rests = false;            ///< the force: five of six, as long as the control asks for it
    std::uint64_t accepted = 0;
    std::uint64_t newest_command = 0;
    std::uint64_t numbered = 0;
    std::uint64_t newest_reply = 0;
    double bulk_from_ns = 1e18;  ///< pieces are fetched from then on
    double bulk_per_s = 0;       ///< 0: as the control says
    double bulk_credit = 0;
    std::uint64_t pieces = 0;
  };

  World(const Way& way, const std::vector<Flow>& stations, std::uint64_t seed = 1)
      : flows(stations), way_(way), random_(seed) {
    set(way);
    for (std::size_t i = 0; i < flows.size(); ++i)
      at(flows[i].begin_ns + 0.13e6 * static_cast<double>(i), [this, i](double now) { tick(i, now); });
  }
  void set(const Way& way) {
    way_ = way;
    for (Pipe* const p : {&up, &down}) {
      p->ns_per_byte = way.kbit_s > 0 ? 8e6 / way.kbit_s : 0;
      p->queue_bytes = 1024 * way.queue_kib;
    }
  }
  void run(double until_ns, const std::function<void(std::size_t, double, double)>& on_rtt = {}) {
    on_rtt_ = on_rtt;
    while (!events_.empty() && events_.top().ns <= until_ns) {
      const Event e = events_.top();
      events_.pop();
      e.what(e.ns);
    }
  }

  std::vector<Flow> flows;
  Pipe up, down;

 private:
  struct Event {
    double ns;
    std::uint64_t n;
    std::function<void(double)> what;
    bool operator<(const Event& o) const { return std::tie(ns, n) > std::tie(o.ns, o.n); }
  };
  void at(double ns, std::function<void(double)> what) { events_.push({ns, n_++, std::move(what)}); }
  double jitter_ns() {
    return way_.jitter_ms > 0 ? -1e6 * way_.jitter_ms * std::log(1 - random_.uniform()) : 0;
  }

  /// When it comes out of a pipe that it has gone through.
  double out_ns(Pipe& pipe, double through_ns) {
    const double out = through_ns + 0.5e6 * way_.rtt_ms + jitter_ns();
    if (way_.any_order) return out;
    return pipe.out_ns = std::max(pipe.out_ns, out);
  }

  void tick(std::size_t i, double now) {
    Flow& f = flows[i];
    if (now > f.end_ns) return;
    double next = now + 1e6;
    if (f.stall_every_ns > 0 && std::fmod(now, f.stall_every_ns) < 1e6) next += f.stall_ns;
    at(next, [this, i](double t) { tick(i, t); });
    const auto t = static_cast<std::int64_t>(now);
    f.control.update(t);
    fetch(i, now);
    if (!f.control.may_send()) return;
    f.control.sent(t);
    const std::uint64_t command = ++f.command;
    ++f.sent;
    const double bytes = kCommandBytes + kRepeatBytes * static_cast<double>(f.control.redundancy());
    const double through = up.send(now, bytes);
    if (through < 0 || random_.uniform() < way_.loss) return;
    const double there = out_ns(up, through);
    at(there, [this, i, command, now](double arrival) {
      Flow& s = flows[i];
      if (command < s.newest_command) return;  // overtaken: dropped, as a server does
      s.newest_command = command;
      const bool spares = s.rests && s.control.reply_deadband_share() > 0;
      if (++s.accepted % (spares ? 6 : s.leaves_out + 1) != 0) return;
      const ReplyNumbers numbers{command, ++s.numbered, s.accepted - s.numbered};
      const double out = down.send(arrival, kReplyBytes);
      if (out < 0 || random_.uniform() < way_.loss) return;
      const double back = out_ns(down, out);
      at(back, [this, i, numbers, now](double t4) {
        Flow& g = flows[i];
        if (numbers.sequence < g.newest_reply) return g.control.on_late_reply();
        g.newest_reply = numbers.sequence;
        ++g.got;
        g.control.on_reply(static_cast<std::int64_t>(t4), static_cast<std::int64_t>(t4 - now), numbers);
        if (on_rtt_) on_rtt_(i, t4, t4 - now);
      });
    });
  }

  /// Two pieces a tick at most, as the loop does; a lost one is no news to anybody here.
  void fetch(std::size_t i, double now) {
    Flow& f = flows[i];
    if (now < f.bulk_from_ns) return;
    const double per_s = f.bulk_per_s > 0 ? f.bulk_per_s : f.control.bulk_per_s();
    f.bulk_credit = std::min(8.0, f.bulk_credit + 1e-3 * per_s);
    for (; f.bulk_credit >= 1; f.bulk_credit -= 1) {
      f.control.bulk_sent(static_cast<std::int64_t>(now));
      const double through = up.send(now, kAskBytes);
      if (through < 0 || random_.uniform() < way_.loss) continue;
      at(through + 0.5e6 * way_.rtt_ms, [this, i](double arrival) {
        if (down.send(arrival, kPieceBytes) >= 0 && random_.uniform() >= way_.loss) ++flows[i].pieces;
      });
    }
  }

  Way way_;
  Random random_;
  std::priority_queue<Event> events_;
  std::uint64_t n_ = 0;
  std::function<void(std::size_t, double, double)> on_rtt_;
};

World::Flow flow(double full_hz = 1000, bool adapts = true, std::size_t redundancy = 0, double start_hz = 0) {
  World::Flow f;
  RateControlConfig config;
  config.full_hz = full_hz;
  config.start_hz = start_hz > 0 ? start_hz : config.start_hz;
  config.adapts = adapts;
  config.redundancy = redundancy;
  f.control = RateControl(config);
  return f;
}

struct Seen {
  double worst_ms = 0;
  double mean_ms = 0;
  double got_hz = 0;
};

Seen watch(World& world, double from_s, double to_s, std::size_t which = 0) {
  world.run(from_s * 1e9);
  Seen seen;
  double sum = 0;
  const std::uint64_t before = world.flows[which].got;
  world.run(to_s * 1e9, [&](std::size_t i, double, double rtt_ns) {
    if (i != which) return;
    seen.worst_ms = std::max(seen.worst_ms, 1e-6 * rtt_ns);
    sum += 1e-6 * rtt_ns;
  });
  const auto n = static_cast<double>(world.flows[which].got - before);
  seen.mean_ms = n > 0 ? sum / n : 0;
  seen.got_hz = n / (to_s - from_s);
  return seen;
}

// What the wire can carry of one station: the reply is the longer one.
double capacity_hz(double kbit_s) {
  return kbit_s * 1e3 / 8 / kReplyBytes;
}

// Asked: 1 Mbit/s behind 64 KiB, RTT at most 30 ms within 2 s at any starting rate.
TEST(RateControl, EmptiesThe64KiBQueueOfAMegabitWithinTwoSeconds) {
  World fixed({1000, 64, 4}, {flow(1000, false)});
  EXPECT_GT(watch(fixed, 2, 10).worst_ms,
            400);  // what is mended: 524 ms of queue, the RTT of who does not ask
  for (const double start_hz : {1000.0, 700.0, 431.0, 200.0}) {
    World world({1000, 64, 4}, {flow(1000, true, 0, start_hz)});
    const Seen seen = watch(world, 2, 20);
    EXPECT_LE(seen.worst_ms, 30) << start_hz;
    EXPECT_GT(seen.got_hz, 0.75 * capacity_hz(1000)) << start_hz;
    std::printf("from %4.0f Hz: worst %.1f ms, mean %.1f ms, %.0f of %.0f Hz\n", start_hz, seen.worst_ms,
                seen.mean_ms, seen.got_hz, capacity_hz(1000));
  }
}

// Bulk on the same wire: a snapshot of any size, begun at rest or with the session.
TEST(RateControl, ASnapshotOverAMegabitLeavesNoQueueAfterTwoSeconds) {
  for (const double begin_s : {0.0, 5.0}) {
    for (const bool paced : {false, true}) {
      World::Flow f = flow();
      f.bulk_from_ns = begin_s * 1e9;
      f.bulk_per_s = paced ? 0 : 2000;
      World world({1000, 64, 4}, {f});
      world.run((begin_s + 2) * 1e9);
      const std::uint64_t before = world.flows[0].pieces;
      const Seen seen = watch(world, begin_s + 2, begin_s + 20);
      const double bytes_s = kPieceBytes * static_cast<double>(world.flows[0].pieces - before) / 18;
      std::printf("bulk from %.0f s, %s: worst %.1f ms, %.0f Hz, %.0f kbit/s of pieces\n", begin_s,
                  paced ? "paced" : "2000 a second", seen.worst_ms, seen.got_hz, 8e-3 * bytes_s);
      if (!paced) {
        EXPECT_TRUE(seen.worst_ms > 400 || seen.got_hz < 20) << seen.got_hz;  // what is mended
        continue;
      }
      EXPECT_LE(seen.worst_ms, 30) << begin_s;
      EXPECT_GT(bytes_s, 0.4 * 125'000) << begin_s;
      EXPECT_GE(seen.got_hz, 50) << begin_s;
    }
  }
}

TEST(RateControl, BulkIsAsFastAsEverWhereThereIsRoom) {
  World::Flow f = flow();
  f.bulk_from_ns = 0;
  World world({0, 64, 20, 0.02}, {f});
  world.run(0.7e9);
  EXPECT_EQ(world.flows[0].control.bulk_per_s(), RateControl::kBulkMost_per_s);
  // Jitter is no queue, also while a fetch runs.
  World radio({0, 64, 20, 0.02, 2}, {f});
  radio.run(10e9);
  EXPECT_GE(radio.flows[0].control.rate_hz(), 900);
  EXPECT_GE(radio.flows[0].control.bulk_per_s(), 900);
  EXPECT_EQ(flow(100, false).control.bulk_per_s(), RateControl::kBulkMost_per_s);
}

TEST(RateControl, ComesBackUpWhenTheLinkIsFree) {
  World world({1000, 64, 4}, {flow()});
  EXPECT_LT(watch(world, 2, 10).got_hz, 450);
  world.set({0, 64, 4});
  world.run(15e9);
  EXPECT_EQ(world.flows[0].control.rate_hz(), 1000);
  EXPECT_EQ(world.flows[0].control.reason(), RateReason::kFull);
  world.set({1000, 64, 4});
  EXPECT_LE(watch(world, 17, 25).worst_ms, 30);
}

TEST(RateControl, TwoStationsShareFairly) {
  for (const double late_s : {0.0, 0.4, 5.0}) {
    for (const std::uint64_t seed : {1, 2, 3}) {
      std::vector<World::Flow> flows{flow(), flow()};
      flows[1].begin_ns = late_s * 1e9;
      World world({1000, 64, 4, 0, 0.1}, flows, seed);
      world.run(late_s * 1e9);
      const double before = static_cast<double>(world.flows[0].got);
      double worst_ms = 0;
      world.run((late_s + 60) * 1e9, [&](std::size_t, double now, double rtt_ns) {
        if (now > (late_s + 3) * 1e9) worst_ms = std::max(worst_ms, 1e-6 * rtt_ns);
      });
      const double a = static_cast<double>(world.flows[0].got) - before;
      const double b = static_cast<double>(world.flows[1].got);
      const double jain = (a + b) * (a + b) / (2 * (a * a + b * b));
      EXPECT_GE(jain, 0.95) << late_s << " s, seed " << seed;
      EXPECT_GE((a + b) / 60, 0.7 * capacity_hz(1000));
      EXPECT_LE(worst_ms, 50);
      std::printf("late %.1f s: %.0f and %.0f Hz, Jain %.4f, worst %.1f ms\n", late_s, a / 60, b / 60, jain,
                  worst_ms);
    }
  }
}

// Loopback, wireless jitter, a machine that stands still for 20 ms: no queue is there, and none is to be
// seen.
TEST(RateControl, KeepsTheFullRateWhereNothingLimitsIt) {
  for (const double jitter_ms : {0.02, 0.5, 2.0}) {
    for (const double stall_every_s : {0.0, 0.3, 1.0}) {
      World::Flow f = flow();
      f.stall_every_ns = stall_every_s * 1e9;
      f.stall_ns = 20e6;
      World world({0, 64, 0.1, 0, jitter_ms}, {f});
      double sum = 0;
      int n = 0;
      for (double t = 1; t < 30; t += 0.01, ++n) {
        world.run(t * 1e9);
        sum += world.flows[0].control.rate_hz();
      }
      EXPECT_GE(sum / n, 0.98 * 1000) << jitter_ms << " ms, " << stall_every_s << " s";
    }
  }
}

// What netem and many radios do: each datagram has a delay of its own. Before, 20 ms left 70 Hz of 1000.
TEST(RateControl, JitterThatReordersIsNeitherQueueNorLoss) {
  for (const double rtt_ms : {4.0, 100.0}) {
    for (const double jitter_ms : {1.0, 3.0, 5.0, 10.0, 20.0}) {
      World world({0, 64, rtt_ms, 0, jitter_ms, true}, {flow()});
      world.run(5e9);
      double sum_hz = 0;
      int n = 0;
      for (double t = 5; t < 35; t += 0.01, ++n) {
        world.run(t * 1e9);
        sum_hz += world.flows[0].control.rate_hz();
      }
      EXPECT_GE(sum_hz / n, 750) << rtt_ms << " ms, jitter " << jitter_ms << " ms";
    }
  }
}

// A queue is seen on such a path too, and so are its losses.
TEST(RateControl, APathThatReordersHasQueuesAndLossesToo) {
  World fixed({1000, 64, 4, 0, 5, true}, {flow(1000, false)});
  EXPECT_GT(watch(fixed, 5, 20).mean_ms, 400);
  World world({1000, 64, 4, 0, 5, true}, {flow()});
  const Seen seen = watch(world, 5, 30);
  EXPECT_LE(seen.mean_ms, 40);
  EXPECT_GE(seen.got_hz, 100);
  World lossy({0, 64, 20, 0.3, 5, true}, {flow()});
  lossy.run(3e9);
  EXPECT_EQ(lossy.flows[0].control.reason(), RateReason::kLoss);
  World chance({0, 64, 20, 0.05, 5, true}, {flow()});
  chance.run(20e9);
  EXPECT_EQ(chance.flows[0].control.lowered(), 0u);
  std::printf("1 Mbit/s, reordering by 5 ms: mean round trip %.1f ms, worst %.1f, %.0f Hz\n", seen.mean_ms,
              seen.worst_ms, seen.got_hz);
}

TEST(RateControl, SweepOfLinksKeepsDelayAndRate) {
  int cases = 0;
  double worst_over_ms = 0;
  double least_share = 1e9;
  for (const double kbit_s : {300.0, 1000.0, 2000.0, 10'000.0, 100'000.0}) {
    for (const double queue_kib : {8.0, 64.0, 1024.0}) {
      for (const double rtt_ms : {1.0, 30.0, 300.0}) {
        for (const double loss : {0.0, 0.01, 0.05}) {
          World world({kbit_s, queue_kib, rtt_ms, loss}, {flow()}, 7);
          const Seen seen = watch(world, 10, 30);
          const double could_hz = std::min(1000.0, capacity_hz(kbit_s)) * (1 - loss) * (1 - loss);
          const double over_ms = seen.mean_ms - rtt_ms - 8e-3 * (kCommandBytes + kReplyBytes) / kbit_s * 1e3;
          const std::string text = std::to_string(kbit_s) + " kbit/s, " + std::to_string(queue_kib) +
                                   " KiB, " + std::to_string(rtt_ms) + " ms, loss " + std::to_string(loss);
          // Half of what the wire carries is not starving; over 300 ms each wrong step is felt for 0.4 s.
          EXPECT_GE(seen.got_hz, (rtt_ms > 100 ? 0.5 : 0.7) * could_hz) << text;
          EXPECT_LE(over_ms, rtt_ms > 100 ? 100 : 20) << text;
          worst_over_ms = std::max(worst_over_ms, over_ms);
          least_share = std::min(least_share, seen.got_hz / could_hz);
          if (seen.got_hz < 0.6 * could_hz || over_ms > 30)
            std::printf("%s: %.0f of %.0f Hz, queue %.1f ms, worst %.1f\n", text.c_str(), seen.got_hz,
                        could_hz, over_ms, seen.worst_ms);
          ++cases;
        }
      }
    }
  }
  std::printf("%d links: mean queue at most %.1f ms, at least %.2f of what the wire carries\n", cases,
              worst_over_ms, least_share);
}

// 64 bytes each: four of them are more than half as much again. They would fill the queue that they answer.
TEST(RateControl, RepeatsNothingWhileAQueueStands) {
  World world({1000, 64, 4}, {flow(1000, true, 4, 1000)});
  EXPECT_EQ(world.flows[0].control.redundancy(), 4u);
  const Seen seen = watch(world, 2, 20);
  EXPECT_LE(seen.worst_ms, 30);
  EXPECT_EQ(world.flows[0].control.redundancy(), 0u);
  EXPECT_GT(world.flows[0].control.deadband_factor(), 2);
  // Losses at chance on a link with room are what repeating is for.
  World radio({0, 64, 4, 0.05}, {flow(1000, true, 4)});
  radio.run(10e9);
  EXPECT_EQ(radio.flows[0].control.redundancy(), 4u);
  EXPECT_EQ(radio.flows[0].control.rate_hz(), 1000);
}

TEST(RateControl, KeepsARateThatAPersonChose) {
  World world({300, 64, 4}, {flow(400, false)});
  EXPECT_NEAR(watch(world, 0, 10).got_hz, capacity_hz(300), 3);
  EXPECT_EQ(world.flows[0].control.rate_hz(), 400);
  EXPECT_EQ(world.flows[0].control.reason(), RateReason::kFixed);
  EXPECT_NEAR(static_cast<double>(world.flows[0].sent), 4000, 2);
}

// Room for two datagrams: no queue can be seen, what is too much is dropped. Half of the capacity at least,
// and of what is sent no more lost than the 19 % of chance and a step beyond it.
TEST(RateControl, GivesWayToALinkThatDropsWithoutAQueue) {
  World world({500, 0.7, 20}, {flow()}, 3);
  world.run(10e9);
  const auto sent = world.flows[0].sent;
  const auto got = world.flows[0].got;
  world.run(40e9);
  const double share =
      static_cast<double>(world.flows[0].got - got) / static_cast<double>(world.flows[0].sent - sent);
  EXPECT_GE(share, 0.7);
  EXPECT_GE(static_cast<double>(world.flows[0].got - got) / 30, 0.5 * capacity_hz(500));
}

// A longer way (a route, a handover) looks like a queue. It is found out by what a queue does: it drains.
TEST(RateControl, TakesALongerWayForWhatItIs) {
  World world({0, 64, 10}, {flow()});
  world.run(5e9);
  world.set({0, 64, 60});
  world.run(20e9);
  EXPECT_EQ(world.flows[0].control.rate_hz(), 1000);
  EXPECT_NEAR(world.flows[0].control.base_ns(), 60e6, 1e6);
}

// Five of six replies are left out: the link is as good as it is, and nothing is lost.
TEST(RateControl, RepliesThatAreLeftOutAreNoLoss) {
  World::Flow f = flow();
  f.leaves_out = 5;
  World world({0, 64, 10}, {f});
  world.run(10e9);
  EXPECT_EQ(world.flows[0].control.rate_hz(), 1000);
  EXPECT_EQ(world.flows[0].control.lowered(), 0u);
  // 6 % each way are chance; of 30 % each way the rate falls, and by as much as with every reply there.
  world.set({0, 64, 10, 0.06});
  world.run(20e9);
  EXPECT_EQ(world.flows[0].control.lowered(), 0u);
  double hz[2] = {0, 0};
  for (const std::uint64_t leaves_out : {0u, 5u}) {
    World::Flow g = flow();
    g.leaves_out = leaves_out;
    World bad({0, 64, 10, 0.3}, {g});
    bad.run(1.2e9);
    EXPECT_EQ(bad.flows[0].control.reason(), RateReason::kLoss) << leaves_out;
    hz[leaves_out > 0] = bad.flows[0].control.rate_hz();
  }
  EXPECT_NEAR(hz[1], hz[0], 0.15 * hz[0]);
}

// What the link carries is counted by commands: with five of six replies left out, a queue lowers the rate
// to a part of those, not of the replies that came.
TEST(RateControl, AQueueLowersTheRateNoFurtherForRepliesLeftOut) {
  double commands_s[2] = {0, 0};
  for (const std::uint64_t leaves_out : {0u, 5u}) {
    World::Flow f = flow();
    f.leaves_out = leaves_out;
    World world({500, 64, 4}, {f});
    world.run(5e9);
    const std::uint64_t before = world.flows[0].sent;
    world.run(25e9);
    EXPECT_GT(world.flows[0].control.lowered(), 0u);
    commands_s[leaves_out > 0] = static_cast<double>(world.flows[0].sent - before) / 20;
  }
  std::printf("commands a second: %.0f, and %.0f with five of six replies left out\n", commands_s[0],
              commands_s[1]);
  EXPECT_GE(commands_s[1], 0.65 * commands_s[0]);
}

// A force that rests for two seconds and moves for half of one: then every reply is there. The rate has not risen into
// the room that was left by those that were not.
TEST(RateControl, AForceThatMovesAgainFindsItsRoom) {
  for (const double kbit_s : {300.0, 500.0, 1000.0}) {
    World world({kbit_s, 64, 4}, {flow()});
    world.run(3e9);
    double worst_ms = 0;
    std::uint64_t replies = 0, exchanges = 0;
    for (double at_s = 3; at_s < 43; at_s += 2.5) {
      World::Flow& f = world.flows[0];
      const std::uint64_t numbered = f.numbered, accepted = f.accepted;
      f.rests = true;
      world.run((at_s + 2) * 1e9);
      replies += f.numbered - numbered;
      exchanges += f.accepted - accepted;
      f.rests = false;
      world.run((at_s + 2.5) * 1e9,
                [&](std::size_t, double, double rtt_ns) { worst_ms = std::max(worst_ms, 1e-6 * rtt_ns); });
    }
    std::printf("%.0f kbit/s: %.2f replies a command at rest, longest round trip in motion %.1f ms\n", kbit_s,
                static_cast<double>(replies) / static_cast<double>(exchanges), worst_ms);
    EXPECT_LE(worst_ms, kbit_s < 400 ? 60 : 30) << kbit_s;
    EXPECT_LT(static_cast<double>(replies), 0.4 * static_cast<double>(exchanges)) << kbit_s;
  }
}

TEST(RateControl, TheReplyDeadbandIsForALinkThatIsFull) {
  World world({500, 64, 4}, {flow()});
  EXPECT_EQ(world.flows[0].control.reply_deadband_share(), 0) << "not known yet";
  world.run(10e9);
  const RateControl& control = world.flows[0].control;
  EXPECT_GT(control.reply_deadband_share(), 0.7);  // of 1000 Hz some 200
  EXPECT_LE(control.reply_deadband_share(), 1);
  // Room again: every reply is asked for now and then, and for good when there is no queue.
  world.flows[0].leaves_out = 5;
  world.set({0, 64, 4});
  world.run(19e9);
  EXPECT_LT(control.rate_hz(), 300) << "not into the room of those that are left out";
  world.run(21e9);
  EXPECT_EQ(control.reply_deadband_share(), 0);
  world.flows[0].leaves_out = 0;
  world.run(40e9);
  EXPECT_EQ(control.rate_hz(), 1000);
  EXPECT_EQ(control.reply_deadband_share(), 0);
  // A narrow one that also loses 3 % each way: three of its replies may be missing too often.
  World lossy({500, 64, 4, 0.03}, {flow()});
  lossy.run(20e9);
  EXPECT_LT(lossy.flows[0].control.rate_hz(), 900);
  EXPECT_EQ(lossy.flows[0].control.reply_deadband_share(), 0);
  // One that a person has set a rate for.
  World fixed({500, 64, 4}, {flow(1000, false)});
  fixed.run(10e9);
  EXPECT_EQ(fixed.flows[0].control.reply_deadband_share(), 0);
}

// 64 kbit/s behind 20 kB carry 28 datagrams a second. With every step in some datagram the rate falls as far, and the queue
// drains; a force that is held for 20 ms needs 50, whatever the link carries.
TEST(RateControl, WithStepsTheRateFallsBelowFiftyAndTheQueueDrains) {
  for (const bool steps : {true, false}) {
    World world({64, 20'000.0 / 1024, 40}, {flow()});
    world.flows[0].control.carry_steps(steps);
    const Seen seen = watch(world, 10, 40);
    const double lowest_hz = world.flows[0].control.lowest_hz();
    std::printf("64 kbit/s, %s steps: worst %.0f ms, mean %.0f ms, %.0f Hz, lowest rate %.0f Hz\n",
                steps ? "with" : "no", seen.worst_ms, seen.mean_ms, seen.got_hz, lowest_hz);
    EXPECT_EQ(lowest_hz, steps ? 20 : 50);
    if (steps) {
      EXPECT_LT(seen.mean_ms, 300);
      EXPECT_GT(seen.got_hz, 0.5 * capacity_hz(64));
    } else {
      EXPECT_GT(seen.mean_ms, 1500);
    }
  }
}

// More ticks are more steps: the rate stays where a datagram holds them, and no higher than without.
TEST(RateControl, TheLeastRateCarriesTheSteps) {
  for (const auto& [tick_hz, least_hz] :
       {std::pair{500.0, 20.0}, {1000, 20}, {2000, 40}, {4000, 50}, {8000, 50}}) {
    RateControl control({.full_hz = tick_hz});
    control.carry_steps(true);
    for (std::int64_t t = 0; t < 20'000 * kMs; t += kMs) {  // nothing comes back
      control.update(t);
      if (control.may_send()) control.sent(t);
    }
    EXPECT_EQ(control.rate_hz(), least_hz) << tick_hz;
    control.carry_steps(false);
    EXPECT_EQ(control.rate_hz(), 50) << "at once, without steps";
  }
}

TEST(RateControl, SilenceHalvesAndSpeechBringsBack) {
  RateControl control;
  std::int64_t t = 0;
  std::uint64_t command = 0, reply = 0;
  const auto run = [&](double seconds, bool answers) {
    for (const std::int64_t end = t + std::llround(seconds * 1e9); t < end; t += kMs) {
      if (answers && command > 0) control.on_reply(t, kMs, {command, ++reply, 0});
      control.update(t);
      if (!control.may_send()) continue;
      control.sent(t);
      ++command;
    }
  };
  run(1, true);
  ASSERT_EQ(control.rate_hz(), 1000);
  run(0.25, false);
  EXPECT_EQ(control.rate_hz(), 500);
  EXPECT_EQ(control.reason(), RateReason::kSilence);
  run(5, false);
  EXPECT_EQ(control.rate_hz(), 50);  // the bound
  run(8, true);
  EXPECT_EQ(control.rate_hz(), 1000);
  EXPECT_EQ(control.reason(), RateReason::kFull);
}

// What must go at once goes, and is paid back: the mean stays.
TEST(RateControl, UrgentOnesArePaidBack) {
  RateControlConfig config;
  config.adapts = false;
  config.full_hz = 100;
  RateControl control(config);
  int sent = 0;
  for (int i = 0; i < 2000; ++i) {
    control.update(i * kMs);
    const bool urgent = i % 100 == 3;
    if (!control.may_send(urgent)) continue;
    ++sent;
    control.sent(i * kMs);
  }
  EXPECT_NEAR(sent, 200, 3);  // 2 s at 100 Hz; one in credit at first, one in debt at last
}

}  // namespace
}  // namespace telenano::link

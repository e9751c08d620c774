// A script of what a network and its strangers can do, between a server and two stations: any order of
// datagrams, from any address, whole, changed, replayed, at any time. Whatever the script, the rules of
// PROTOCOL.md hold.
#include <array>
#include <cmath>
#include <map>
#include <vector>

#include "fuzz_input.h"
#include "telenano/common/link/client_session.h"
#include "tests/unit/server/spring_slave.h"

namespace telenano::server {
namespace {

using fuzz::Script;

struct Packet {
  std::uint8_t address = 0;
  std::vector<std::uint8_t> bytes;
};

/// What the server has said under one session id.
struct Said {
  std::uint32_t epoch = 0;
  std::uint64_t reply = 0;
  std::uint64_t command = 0;
  std::uint64_t left_out = 0;
  double energy_in_aj = 0;
  double energy_out_aj = 0;
};

class World {
 public:
  World()
      : server_(config(), scenes()),
        stations_{link::ClientSession(client(1)), link::ClientSession(client(2))} {}

  void run(Script script) {
    // A script's end is also the end of a test: more steps than this show nothing new.
    for (int step = 0; step < 100 && !script.done(); ++step) act(script);
  }

 private:
  static constexpr std::size_t kAddresses = 4;
  static constexpr std::size_t kKept = 64;  ///< datagrams that can still be delivered or replayed, each way

  static ServerConfig config() {
    ServerConfig c;
    c.secret = {7, 8};
    c.table.capacity = 2;  // so that it is full now and then
    c.challenges_per_s = 50;
    c.openings_per_s = 4;
    return c;
  }
  static constexpr std::uint64_t kOtherScene = 0x77;
  static std::vector<ServedScene> scenes() {
    std::vector<ServedScene> scenes;
    scenes.push_back(spring_scene());
    scenes.push_back(spring_scene(nullptr, nullptr, true));
    scenes[1].name = scene_name("with a particle");
    scenes[1].hash = kOtherScene;
    return scenes;
  }
  static link::ClientConfig client(std::uint64_t seed) {
    link::ClientConfig c;
    c.nonce_seed = seed;
    c.redundancy = seed == 2 ? 2 : 0;  // one of them repeats commands
    return c;
  }
  static net::Address address(std::uint8_t i) {
    net::Address a;
    a.ip[15] = static_cast<std::uint8_t>(1 + i % kAddresses);
    a.port = 4000;
    return a;
  }

  void act(Script& script) {
    const std::uint8_t op = script.byte();
    link::ClientSession& station = stations_[(op >> 4) & 1];
    const auto from = static_cast<std::uint8_t>(op >> 5);
    switch (op & 15) {
      case 0:
        now_ns_ += 100'000 * std::int64_t{script.byte()};
        break;
      case 1:
        now_ns_ += 100'000'000 * std::int64_t{script.byte()};
        break;
      case 2:
        station.start(now_ns_);
        break;
      case 3:
        keep(up_, from, station.poll(now_ns_, out_));
        break;
      case 4:
        command(station, from, script);
        break;
      case 5:
        to_server(pick(up_, script), from);
        break;
      case 6:
        to_station(station, pick(down_, script));
        break;
      case 7: {
        std::vector<std::uint8_t> bytes = pick(up_, script);
        change(bytes, script);
        to_server(bytes, from);
        break;
      }
      case 8: {
        std::vector<std::uint8_t> bytes = pick(down_, script);
        change(bytes, script);
        to_station(station, bytes);
        break;
      }
      case 9: {
        const auto raw = script.take(script.word() % 600);
        to_server({raw.begin(), raw.end()}, from);
        break;
      }
      case 10:
        server_.poll(now_ns_);
        break;
      case 11: {
        const std::size_t n = station.make_bye(static_cast<link::ByeReason>(1 + script.byte() % 5), out_);
        keep(up_, from, n);
        break;
      }
      case 12:
        if (script.byte() == 0xff) {  // rarely: nothing begins after it
          net::Address to;
          const std::size_t n = server_.next_bye(now_ns_, out_, to);
          if (n > 0) keep(down_, 0, n);
        }
        break;
      case 13: {
        const std::uint8_t how = script.byte();
        if (how < 64) keep(up_, from, station.make_scene_list_request(how % 4, out_));
        if (how >= 64 && how < 192)
          station.switch_scene(how % 2 == 0 ? kOtherScene : spring_scene().hash, now_ns_);
        if (how >= 192) station.switch_scene(how, now_ns_);  // there is none
        break;
      }
      default:
        tick(station, from, script);
        break;
    }
    check();
  }

  /// A good tick, so that a short script comes far.
  void tick(link::ClientSession& station, std::uint8_t from, Script& script) {
    now_ns_ += 1'000'000;
    server_.poll(now_ns_);
    if (station.state() == link::ClientState::kIdle) station.start(now_ns_);
    if (const std::size_t n = station.poll(now_ns_, out_)) {
      keep(up_, from, n);
      exchange(station, up_.back().bytes, from);
    }
    if (command(station, from, script)) exchange(station, up_.back().bytes, from);
  }
  void exchange(link::ClientSession& station, const std::vector<std::uint8_t> bytes, std::uint8_t from) {
    if (to_server(bytes, from)) to_station(station, std::vector<std::uint8_t>(down_.back().bytes));
  }

  bool command(link::ClientSession& station, std::uint8_t from, Script& script) {
    link::Command c;
    const std::uint8_t kind = script.byte();
    c.flags = kind & 7;
    c.tip_pos_w_nm.z() = static_cast<double>(static_cast<std::int8_t>(script.byte()));
    energy_j_ += 1e-6 * script.byte();  // totals never fall
    c.energy_in_j = energy_j_;
    c.energy_out_j = 0.5 * energy_j_;
    if ((kind & 8) != 0) {
      c.control.method = (kind >> 4) % 7;
      c.control.energy_scale_aj_j = 1e6;
      c.control.energy_sent_j = energy_j_;
      c.control.wave_energy_aj = energy_j_;
      c.control.wave_impedance_n_s_m = 1e-3;
    }
    // By the two bits that the flags leave: none, everything, and the usual.
    if ((kind & 0x80) != 0) c.reply_deadband = {(kind & 0x40) != 0 ? 4'000'000'000u : 10u, 100};
    const std::uint64_t sent = station.commands_sent();
    const bool alive = station.has_session();
    const std::size_t n = station.make_command(c, now_ns_, out_);
    FUZZ_CHECK((n > 0) == alive);
    FUZZ_CHECK(station.commands_sent() == sent + (n > 0 ? 1 : 0));
    if (n == 0) return false;
    keep(up_, from, n);
    return true;
  }

  static void change(std::vector<std::uint8_t>& bytes, Script& script) {
    const std::uint8_t how = script.byte();
    if (bytes.empty()) return;
    if (how < 16) {
      bytes.resize(std::min<std::size_t>(600, script.word()));
    } else {
      for (int i = 0; i < 1 + how % 4; ++i) bytes[script.word() % bytes.size()] = script.byte();
    }
  }

  /// The first n bytes of out_.
  void keep(std::vector<Packet>& packets, std::uint8_t from, std::size_t n) {
    if (n == 0) return;
    if (packets.size() >= kKept) packets.erase(packets.begin());
    Packet& packet = packets.emplace_back();
    packet.address = from;
    packet.bytes.assign(out_.begin(), out_.begin() + static_cast<std::ptrdiff_t>(n));
  }
  /// Counted from the newest.
  static std::vector<std::uint8_t> pick(const std::vector<Packet>& packets, Script& script) {
    const std::size_t back = script.byte();
    return packets.empty() ? std::vector<std::uint8_t>()
                           : packets[packets.size() - 1 - back % packets.size()].bytes;
  }

  bool to_server(const std::vector<std::uint8_t>& bytes, std::uint8_t from) {
    const ServerCounters before = server_.counters();
    const std::uint64_t drops = server_.drops().total();
    const std::size_t n = server_.on_datagram(bytes, address(from), now_ns_, out_);
    const ServerCounters& after = server_.counters();
    const std::uint64_t dropped = server_.drops().total() - drops;

    FUZZ_CHECK(after.datagrams == before.datagrams + 1);
    FUZZ_CHECK(dropped <= 1);  // under one cause
    const bool used = after.exchanges + after.opened + after.resumed + after.ended + after.switched >
                      before.exchanges + before.opened + before.resumed + before.ended + before.switched;
    FUZZ_CHECK(dropped == 1 ? !used : used || n > 0);
    FUZZ_CHECK(n <= link::kMaxDatagramBytes);
    FUZZ_CHECK(after.left_out - before.left_out <= (n == 0 ? after.exchanges - before.exchanges : 0));
    if (n == 0) return false;
    const auto kind = heard(std::span(out_).first(n));
    // To somebody who has not shown a cookie never more than came.
    const auto asked = static_cast<link::MessageType>(bytes.size() > 5 ? bytes[5] : 0);
    const bool in_session =
        asked == link::MessageType::kSceneListRequest || asked == link::MessageType::kSceneSwitch;
    if (in_session) FUZZ_CHECK(server_.sessions().active() > 0);
    if (kind != link::MessageType::kReply && !in_session) FUZZ_CHECK(n <= bytes.size());
    FUZZ_CHECK((kind == link::MessageType::kReply) == (after.exchanges == before.exchanges + 1));
    if (kind == link::MessageType::kReply) FUZZ_CHECK(server_.sessions().active() > 0);
    keep(down_, from, n);
    return true;
  }

  /// Every answer is well formed, and what it says goes on from what was said before.
  link::MessageType heard(std::span<const std::uint8_t> answer) {
    using link::MessageType;
    FUZZ_CHECK(codec_.decode(answer, in_) == link::DropCause::kNone);
    FUZZ_CHECK(in_.type != MessageType::kHello && in_.type != MessageType::kCommand);
    if (in_.type == MessageType::kWelcome) {
      const auto [at, fresh] = said_.try_emplace(in_.welcome.session_id);
      if (fresh) at->second.epoch = in_.welcome.epoch;
      FUZZ_CHECK(at->second.epoch == in_.welcome.epoch);
    }
    if (in_.type != MessageType::kReply) return in_.type;
    const auto at = said_.find(in_.reply.session_id);
    FUZZ_CHECK(at != said_.end());  // no force without a session
    Said& last = at->second;
    FUZZ_CHECK(in_.reply.epoch == last.epoch);
    FUZZ_CHECK(in_.reply.sequence == last.reply + 1);
    FUZZ_CHECK(in_.reply.replies_left_out >= last.left_out &&
               in_.reply.replies_left_out <= in_.reply.command_sequence - in_.reply.sequence);
    last.left_out = in_.reply.replies_left_out;
    FUZZ_CHECK(in_.reply.command_sequence > last.command);
    FUZZ_CHECK(in_.reply.energy_in_aj >= last.energy_in_aj && in_.reply.energy_out_aj >= last.energy_out_aj);
    last.reply = in_.reply.sequence;
    last.command = in_.reply.command_sequence;
    last.energy_in_aj = in_.reply.energy_in_aj;
    last.energy_out_aj = in_.reply.energy_out_aj;
    return in_.type;
  }

  void to_station(link::ClientSession& station, const std::vector<std::uint8_t>& bytes) {
    const std::uint64_t drops = station.drops().total();
    const std::uint64_t sessions = station.sessions();
    const std::uint64_t newest = station.replies().newest();
    const link::ClientEvent event = station.on_datagram(bytes, now_ns_);
    FUZZ_CHECK(station.drops().total() - drops == (event == link::ClientEvent::kDropped ? 1u : 0u));
    FUZZ_CHECK(station.sessions() - sessions == (event == link::ClientEvent::kWelcome ? 1u : 0u));
    if (event == link::ClientEvent::kReply) {
      FUZZ_CHECK(station.replies().newest() > newest);
      FUZZ_CHECK(station.reply().session_id == station.welcome().session_id);
      FUZZ_CHECK(station.reply().epoch == station.welcome().epoch);
      FUZZ_CHECK(station.reply().command_sequence <= station.commands_sent());
    }
  }

  void check() {
    FUZZ_CHECK(server_.sessions().occupied() <= server_.sessions().capacity());
    FUZZ_CHECK(server_.drops().total() <= server_.counters().datagrams);
    for (const link::ClientSession& station : stations_) {
      if (station.state() == link::ClientState::kEstablished) FUZZ_CHECK(station.has_session());
      if (station.has_session()) FUZZ_CHECK(station.welcome().epoch != 0 && station.sessions() > 0);
      if (station.has_reply()) FUZZ_CHECK(is_finite(station.reply().force_w_nn));
    }
  }

  Server server_;
  std::array<link::ClientSession, 2> stations_;
  std::vector<Packet> up_, down_;
  std::map<std::uint64_t, Said> said_;
  link::Codec codec_;
  link::Incoming in_;
  std::int64_t now_ns_ = 1'000'000;
  double energy_j_ = 0;
  std::array<std::uint8_t, link::kMaxDatagramBytes> out_{};
};

}  // namespace
}  // namespace telenano::server

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  telenano::server::World().run({data, size});
  return 0;
}

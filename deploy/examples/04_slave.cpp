// A slave of one's own behind the server: a wall of 5 N/m at z = 0, served on UDP until a signal comes.
//
// usage: 04_slave PORT      then, elsewhere: 03_station 127.0.0.1:PORT
#include <atomic>
#include <csignal>
#include <cstdio>
#include <random>
#include <string>

#include "telenano/common/base/error.h"
#include "telenano/common/net/udp.h"
#include "telenano/common/rt/steady_clock.h"
#include "telenano/nve_server/server/server_loop.h"
#include "wall.h"

using namespace telenano;

namespace {

std::atomic<bool> stop{false};

}  // namespace

int main(int argc, char** argv) try {
  if (argc != 2) throw UserError("usage: 04_slave PORT");
  std::signal(SIGINT, [](int) { stop = true; });
  std::signal(SIGTERM, [](int) { stop = true; });
  std::random_device random;
  const auto bits = [&] { return (std::uint64_t{random()} << 32) | random(); };
  server::ServerConfig config;
  config.secret = link::SipKey{bits(), bits()};
  server::ServedScene served;
  served.make_slave = [] { return std::make_unique<example::Wall>(); };
  server::Server server(config, std::move(served));
  net::Udp socket = net::Udp::listen(net::parse_address(std::string("127.0.0.1:") + argv[1], "PORT"));
  std::fprintf(stderr, "a wall of 5 N/m at %s\n", net::to_string(socket.local()).c_str());
  server::LoopStatus status;
  server::run_loop(
      server, socket, rt::SteadyClock{}, [&](std::int64_t ns) { socket.wait_readable(ns); }, stop, {},
      status);
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "error: %s\n", error.what());
  return 1;
}

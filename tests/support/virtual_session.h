#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "telenano/common/link/client_session.h"
#include "telenano/common/net/sim_link.h"
#include "telenano/common/recording/sample.h"
#include "telenano/common/rt/clock.h"
#include "telenano/master/device/intended_motion.h"
#include "telenano/master/device/sim_device.h"
#include "telenano/master/loop/station_loop.h"
#include "telenano/master/station/station.h"
#include "telenano/nve_server/scene/scene.h"
#include "telenano/nve_server/server/server.h"
#include "tests/support/virtual_hand.h"

namespace telenano::support {

struct VirtualSessionConfig {
  std::shared_ptr<const scene::Scene> scene;  ///< may be null where there is a make_slave
  /// Instead of the scene's virtual environment: any slave, for each session a new one.
  std::function<std::unique_ptr<slave::Slave>()> make_slave{};
  std::uint64_t scene_hash = 0;  ///< that the server says with it
  /// Instead of the simulated device and operator, whose task, script and plant then do not matter.
  std::shared_ptr<VirtualHand> hand{};
  station::StationConfig station{};
  /// Instead of the method that the station is configured for: the same name on the wire, other contents.
  std::function<std::unique_ptr<control::StationMethod>()> make_method{};
  device::Task task = device::Task::kIndent;
  device::TaskOptions task_options{};
  std::vector<device::IntendedMotion::Waypoint> script{};  ///< of Task::kScript
  device::PlantConfig plant{};
  net::SimPath to_server{};
  net::SimPath to_station{};
  std::size_t link_capacity = 4096;  ///< datagrams on the way, each way; what is more is lost
  double server_drift_ppm = 0;       ///< how much faster than the station's the server's clock runs
  std::uint64_t seed = 1;
  server::Share share = server::Share::kPrivate;
  /// Instead of a server of its own: another session's (VirtualSession::shared_server), which must be stepped
  /// at the same rate.
  std::shared_ptr<server::Server> server{};
  std::int64_t start_ns = 0;       ///< its now_ns(): one server has one time
  std::uint16_t port = 0;          ///< of the station's address, where one server has several; 0: the link's
  net::Standing standing{};        ///< what the station's channel vouches for
  std::uint64_t resume_token = 0;  ///< of an earlier station
  std::uint32_t tip_wish = 0;      ///< link::kFlagTakeOver, link::kFlagHandOver
  loop::LinkOptions link_options{};
  bool twin = false;  ///< the station logs its steps and has a twin of the scene
  std::size_t snapshot_bytes_most = std::size_t{16} << 20;  ///< server::ServerConfig
  double twin_look_s = 0;                                   ///< station::TwinRunConfig::look_s
  /// Instead of the scene's own twin: any, called twice.
  std::function<std::unique_ptr<control::LocalSlave>()> make_twin{};
  /// What becomes of each datagram that the server sends, of so many bytes: a server that lies. Returns the
  /// bytes that go; 0: none.
  std::function<std::size_t(std::span<std::uint8_t>, std::size_t)> lie{};
  std::size_t redundancy = 0;  ///< commands that each datagram repeats
};

/// A whole session in virtual time: the same device, station, session and server objects as the programs,
/// over a simulated link. The station ticks at its rate; the server answers each datagram at the moment at
/// which it arrives.
class VirtualSession {
 public:
  explicit VirtualSession(const VirtualSessionConfig& config);

  /// One tick of the station and all that the server does until the next one, `periods` later: with more than
  /// one the station misses ticks, while device and link go on. Returns its row.
  const recording::Sample& step(int periods = 1);
  /// Steps until the task is over (or max_ticks); calls `each` after every step.
  std::int64_t run(std::int64_t max_ticks, const std::function<void(const recording::Sample&)>& each = {});

  /// The server process dies and another one starts in its place, knowing nothing.
  void restart_server();
  /// The server process dies: what arrives is lost until restart_server().
  void kill_server() noexcept { down_ = true; }
  /// The server's clock leaps ahead, as after its machine was suspended.
  void leap_server_clock(std::int64_t ns) noexcept { server_ahead_ns_ += ns; }
  /// The server says Bye to all and withdraws the tips for `ms`, as at SIGTERM; then there is none until
  /// restart_server().
  void stop_server(int ms);
  /// What a server made from now on says of its scene.
  void set_scene_hash(std::uint64_t hash) noexcept { scene_hash_ = hash; }
  /// A server made from now on has another scene of that hash, alike, in which it begins.
  void set_first_scene(std::uint64_t hash) noexcept { first_scene_hash_ = hash; }
  /// What the station's channel vouches for from now on: its key was given another right.
  void set_standing(const net::Standing& standing) noexcept { config_.standing = standing; }
  const std::shared_ptr<server::Server>& shared_server() const noexcept { return server_; }

  /// The task is over; a hand of the test's own is never done.
  bool done() const noexcept { return device_ && device_->motion_done(); }
  device::SimDevice& device() noexcept { return *device_; }  ///< not with a hand of the test's own
  station::Station& station() noexcept { return *station_; }
  link::ClientSession& client() noexcept { return client_; }
  server::Server& server() noexcept { return *server_; }
  net::SimLink& link() noexcept { return link_; }
  loop::StationLoop& loop() noexcept { return *loop_; }
  std::int64_t now_ns() const noexcept { return now_ns_; }
  std::uint64_t bytes_up() const noexcept { return bytes_up_; }  ///< of datagrams that came, without headers
  std::uint64_t datagrams_up() const noexcept { return datagrams_up_; }
  double period_s() const noexcept { return static_cast<double>(period_ns_) * 1e-9; }

 private:
  void make_server();
  void make_device(const link::Welcome& welcome);
  void serve_until(std::int64_t until_ns);
  std::int64_t server_ns(std::int64_t now_ns) const noexcept;  ///< what the server's clock says then

  VirtualSessionConfig config_;
  net::SimLink link_;
  rt::VirtualClock clock_;
  std::shared_ptr<server::Server> server_;
  bool down_ = false;
  std::uint64_t scene_hash_ = 0;
  std::uint64_t first_scene_hash_ = 0;  // 0: there is one scene
  std::uint64_t servers_made_ = 0;
  link::ClientSession client_;
  std::unique_ptr<device::SimDevice> device_;
  std::unique_ptr<station::Station> station_;
  std::unique_ptr<loop::StationLoop> loop_;
  recording::Sample sample_;
  std::int64_t period_ns_ = 0;
  std::int64_t now_ns_ = 0;
  std::int64_t since_last_tick_ns_ = 0;
  std::int64_t server_ahead_ns_ = 0;
  std::uint64_t bytes_up_ = 0, datagrams_up_ = 0;
  bool motion_started_ = false;
};

}  // namespace telenano::support

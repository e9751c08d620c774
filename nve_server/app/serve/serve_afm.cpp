#include "telenano/nve_server/app/serve/serve_afm.h"

#include <fmt/format.h>
#include <unistd.h>
#include <CLI/CLI.hpp>

#include <cstdio>
#include <cstdlib>
#include <optional>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/hash/sha256.h"
#include "telenano/common/metrics/page.h"
#include "telenano/common/net/udp.h"
#include "telenano/common/security/private_file.h"
#include "telenano/nve_server/afm/afm_adapters.h"
#include "telenano/nve_server/afm/afm_driver.h"
#include "telenano/nve_server/afm/afm_slave.h"
#include "telenano/nve_server/afm/guard.h"
#include "telenano/nve_server/app/serve/port_list.h"
#include "telenano/nve_server/app/serve/tip_latch.h"

namespace telenano::app {

namespace {

afm::DeadmanKey read_deadman_key(const std::string& file) {
  if (!has_sha256())
    throw UserError("this program was built without OpenSSL, which a deadman's heartbeats need");
  const auto key = afm::parse_deadman_key(security::read_private_file(file, "[deadman] key"));
  if (!key)
    throw UserError(file +
                    ": [deadman] key: expected 64 hexadecimal digits, as deadman.py new-key makes them");
  return *key;
}

/// What the operator takes upon himself by the description as it is: a line each (SAFETY.md).
std::vector<std::string> risks_of(const afm::AfmConfig& config) {
  std::vector<std::string> risks;
  if (config.deadman_key.empty()) {
    // As the checks set SafeTip: two steps above the slave's own trip.
    const double safe_tip_nn = config.force_max_nn + 4 * config.step_nm * config.spring_constant_n_m;
    risks.push_back(fmt::format(
        "without a deadman: if this machine or the network to the controller fails while the tip is on the "
        "sample, the tip stays there; the controller's SafeTip acts only at some {:.0f} nN",
        safe_tip_nn));
  }
  if (config.along_slope == 0) {
    risks.push_back(
        "without limits.along_slope: no signal shows the force of a face that leans along the lever, which "
        "is thousands of nN at the corner of a wall of 20 nm; give along_slope if you know how steep the "
        "sample is");
  }
  return risks;
}

}  // namespace

struct ServeAfm::Running {
  std::unique_ptr<TipLatch> latch;
  std::unique_ptr<afm::AfmDriver> driver;
  /// Nothing moves any more. Where the tip is known to be up, nobody needs to approve the next approach.
  ~Running() {
    if (!driver) return;
    const bool up = driver->end();
    driver.reset();
    if (up) latch->clear();
  }
};

ServeAfm::ServeAfm() : exchange_(std::make_shared<afm::AfmExchange>()) {}
ServeAfm::~ServeAfm() = default;

void ServeAfm::add_flags(CLI::App& command) {
  std::vector<std::string> slaves = afm::adapter_names();
  slaves.insert(slaves.begin(), "nve");
  command
      .add_option("--slave", slave_,
                  "nve: the virtual environment; nanonis: a real AFM with a Nanonis controller")
      ->capture_default_str()
      ->check(CLI::IsMember(slaves))
      ->type_name("NAME");
  command.add_option("--controller", controller_, "Host name or address of the AFM controller")
      ->type_name("HOST");
  command
      .add_option("--ports", ports_,
                  "TCP ports of the controller for motion, signals, data and emergency; a range or a list")
      ->capture_default_str();
  command
      .add_option("--afm-state", state_,
                  "Folder where the server notes that the tip may be near the sample [$STATE_DIRECTORY, else "
                  "~/.local/state/telenano]")
      ->type_name("FOLDER");
  command.add_flag("--without-deadman", without_deadman_,
                   "Run without a deadman next to the controller: if this machine or the network fails, the "
                   "tip stays on the sample");
  command.add_option("--afm", afm_, "Description of the AFM and its limits (TOML, see deploy/afm.toml)")
      ->type_name("FILE");
}

void ServeAfm::check(const std::string& scene, const std::string& share) const {
  if (!wanted()) {
    if (scene.empty())
      throw UserError("serve: --scene is missing: expected a scene file, or --slave nanonis");
    if (!controller_.empty() || !afm_.empty() || !state_.empty() || without_deadman_)
      throw UserError(
          "serve: --controller, --afm, --afm-state and --without-deadman belong to --slave nanonis");
    return;
  }
  if (!scene.empty()) throw UserError("serve: --scene belongs to --slave nve: an AFM has its own sample");
  if (controller_.empty())
    throw UserError("serve: --controller is missing: expected the host of the AFM's controller");
  if (afm_.empty()) throw UserError("serve: --afm is missing: expected a file like deploy/afm.toml");
  if (share == "private")
    throw UserError("serve: --share private: an AFM has one tip; omit --share, or give --share one-tip");
}

server::ServedScene ServeAfm::start(const rt::Clock& clock, const std::atomic<bool>& stop,
                                    int realtime_priority, std::function<void(const std::string&)> news) {
  const afm::AfmConfig config = afm::load_afm_config(afm_);
  const auto ports = parse_port_list(ports_, "--ports");
  if (config.deadman_key.empty() && !without_deadman_)
    throw UserError(
        afm_ +
        ": [deadman] key is missing: without a deadman beside the controller the tip stays on the sample "
        "when "
        "this machine or the network dies (deploy/afm/deadman.py); --without-deadman takes that risk");
  if (!config.deadman_key.empty() && without_deadman_)
    throw UserError("--without-deadman: " + afm_ + " names a deadman ([deadman] key): omit one of the two");
  afm::DriverOptions options;
  options.adapter = slave_;
  options.realtime_priority = realtime_priority;
  std::string emergency;
  for (std::size_t i = 0; i < ports.size(); ++i) {
    if (ports[i] == 0) throw UserError("--ports '" + ports_ + "': 0 is not a port of a controller");
    const std::string text = controller_ + ":" + std::to_string(ports[i]);
    const net::Address address = net::parse_address(text, "--controller");
    if (i < options.ports.size()) {
      options.ports[i] = address;
    } else {
      emergency = net::to_string(address);
    }
  }
  auto running = std::make_unique<Running>();
  running->latch = std::make_unique<TipLatch>(state_folder(state_), emergency);
  options.approved = !running->latch->held();
  options.before_approach = [latch = running->latch.get(), news, risks = risks_of(config)] {
    latch->set();
    for (const std::string& risk : risks) news(risk);
  };
  options.take_approval = [latch = running->latch.get()] { return latch->take_approval(); };
  afm::await_last_guard(emergency, stop, news);
  if (!config.deadman_key.empty() && !stop.load(std::memory_order_relaxed))
    afm::meet_deadman(net::parse_address(emergency, "--controller"), read_deadman_key(config.deadman_key));
  // A guard of a unit of its own, where the server's unit names one.
  const char* const guard = std::getenv("TELENANO_AFM_GUARD");
  options.emergency_handle =
      guard != nullptr && *guard != 0
          ? afm::call_guard(guard, {emergency, config.guard_silence_ms(), config.deadman_key})
          : afm::start_guard(emergency, config.guard_silence_ms(), config.deadman_key);
  running->driver = std::make_unique<afm::AfmDriver>(config, options, exchange_, clock, std::move(news));
  running_ = std::move(running);
  try {
    running_->driver->start(stop);
  } catch (const UserError&) {
    running_.reset();  // removes the latch where the tip is up

    throw;
  }

  server::ServedScene served;
  served.name = server::scene_name("afm");
  served.one_tip_only = true;
  served.make_slave = [config, exchange = exchange_, &clock] {
    return std::make_unique<afm::AfmSlave>(config, exchange, clock);
  };
  return served;
}

void ServeAfm::write_metrics(metrics::Page& page) const {
  afm::PortState s;
  if (!wanted() || !exchange_->load_state(s)) return;
  page.gauge("telenano_afm_following", "1 while the tip is at the surface and follows",
             s.phase == afm::Phase::kFollowing ? 1 : 0);
  page.gauge("telenano_afm_withdrawn", "1 while the tip is up", s.phase == afm::Phase::kWithdrawn ? 1 : 0);
  page.counter("telenano_afm_withdrawals_total", "Withdrawals that an operator must clear",
               static_cast<double>(s.latches));
  page.gauge("telenano_afm_force_newtons", "Newest reading of the force along Z",
             1e-9 * s.measured_force_w_nn.z());
  page.gauge("telenano_afm_drift_metres_per_second",
             "Drift of the height at which the tip touches, measured by its touches", 1e-9 * s.drift_nm_s);
  page.gauge("telenano_afm_surface_bound_metres",
             "The surface is within this distance of W's zero, 95 % of the time", 1e-9 * s.surface_bound_nm);
}

void ServeAfm::stop() {
  running_.reset();
}

CLI::App* add_afm_command(CLI::App& app) {
  struct Options {
    std::string state, controller;
  };
  auto options = std::make_shared<Options>();
  CLI::App* const command = app.add_subcommand("afm", "Approve an approach of an AFM's tip");
  command->require_subcommand(1);
  CLI::App* const approve = command->add_subcommand(
      "approve", "Allow one approach after a server ended without withdrawing the tip");
  approve
      ->add_option("--afm-state", options->state,
                   "State folder of the server [$STATE_DIRECTORY, else ~/.local/state/telenano]")
      ->type_name("FOLDER");
  approve
      ->add_option("--controller", options->controller,
                   "Emergency port of the controller, if the folder knows several")
      ->type_name("HOST:PORT");
  approve->footer(
      "First make sure that the tip is up and the sample is unchanged. The systemd service keeps its state "
      "in\n/var/lib/telenano.");
  approve->callback([options] {
    const std::string latch = approve_tip(state_folder(options->state), options->controller);
    std::fprintf(stderr, "telenano-nve: approved one approach (%s)\n", latch.c_str());
  });
  return command;
}

void add_afm_guard_command(CLI::App& app, int& exit_code) {
  CLI::App* const command = app.add_subcommand("afm-guard", "Started by serve --slave nanonis; not by hand");
  command->group("");
  auto emergency = std::make_shared<std::string>();
  auto silence_ms = std::make_shared<int>(400);
  auto from_server = std::make_shared<bool>(false);
  command->add_option("--emergency", *emergency, "HOST:PORT");
  command->add_flag("--from-server", *from_server, "The server says all this itself (systemd's unit)");
  command->add_option("--silence-ms", *silence_ms, "Of the server, before the guard withdraws the tip");
  auto key_file = std::make_shared<std::string>();
  command->add_option("--deadman-key", *key_file, "Between it and the controller there is one that has this");
  command->callback([emergency, silence_ms, key_file, from_server, &exit_code] {
    afm::GuardOrder order{*emergency, *silence_ms, *key_file};
    if (*from_server) {
      const auto said = afm::read_guard_order(STDIN_FILENO);
      if (!said) throw UserError("afm-guard: standard input is not a server that wants a guard");
      order = *said;
    }
    if (order.emergency.empty()) throw UserError("afm-guard: --emergency is missing: expected HOST:PORT");
    std::optional<afm::DeadmanKey> key;
    if (!order.key_file.empty()) key = read_deadman_key(order.key_file);
    exit_code = afm::run_guard(STDIN_FILENO, net::parse_address(order.emergency, "--emergency"),
                               order.silence_ms, key);
  });
}

}  // namespace telenano::app

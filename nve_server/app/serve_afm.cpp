#include "nve_server/app/serve_afm.h"

#include <unistd.h>

#include "common/base/error.h"
#include "common/net/udp.h"
#include "nve_server/afm/afm_driver.h"
#include "nve_server/afm/afm_slave.h"
#include "nve_server/afm/guard.h"
#include "nve_server/app/port_list.h"

namespace telenano::app {

struct ServeAfm::Running {
  std::shared_ptr<afm::AfmExchange> exchange = std::make_shared<afm::AfmExchange>();
  std::unique_ptr<afm::AfmDriver> driver;
};

ServeAfm::ServeAfm() = default;
ServeAfm::~ServeAfm() = default;

void ServeAfm::add_flags(CLI::App& command) {
  command.add_option("--slave", slave_, "nve: a virtual environment; nanonis: an AFM by its controller")
      ->capture_default_str()
      ->check(CLI::IsMember({"nve", "nanonis"}))
      ->type_name("NAME");
  command.add_option("--controller", controller_, "Host of the AFM's controller")->type_name("HOST");
  command.add_option("--ports", ports_, "Its TCP ports: motion, reads, data, emergency; a range or a list")
      ->capture_default_str();
  command.add_option("--afm", afm_, "The rig and its limits (TOML; see deploy/afm.toml)")->type_name("FILE");
}

void ServeAfm::check(const std::string& scene) const {
  if (!wanted()) {
    if (scene.empty())
      throw UserError("serve: --scene is missing: expected a scene file, or --slave nanonis");
    if (!controller_.empty() || !afm_.empty())
      throw UserError("serve: --controller and --afm belong to --slave nanonis");
    return;
  }
  if (!scene.empty()) throw UserError("serve: --scene belongs to --slave nve: an AFM has its own sample");
  if (controller_.empty())
    throw UserError("serve: --controller is missing: expected the host of the AFM's controller");
  if (afm_.empty()) throw UserError("serve: --afm is missing: expected a file like deploy/afm.toml");
}

server::ServedScene ServeAfm::start(const rt::Clock& clock, const std::atomic<bool>& stop,
                                    std::function<void(const std::string&)> news) {
  const afm::AfmConfig config = afm::load_afm_config(afm_);
  const auto ports = parse_port_list(ports_, "--ports");
  afm::DriverOptions options;
  std::string emergency;
  for (std::size_t i = 0; i < ports.size(); ++i) {
    if (ports[i] == 0) throw UserError("--ports '" + ports_ + "': 0 is no port of a controller");
    const std::string text = controller_ + ":" + std::to_string(ports[i]);
    const net::Address address = net::parse_address(text, "--controller");
    if (i < options.ports.size()) {
      options.ports[i] = address;
    } else {
      emergency = net::to_string(address);
    }
  }
  afm::await_last_guard(emergency, stop, news);
  options.emergency_handle = afm::start_guard(emergency, config.guard_silence_ms());
  running_ = std::make_unique<Running>();
  running_->driver =
      std::make_unique<afm::AfmDriver>(config, options, running_->exchange, clock, std::move(news));
  running_->driver->start(stop);

  server::ServedScene served;
  served.name = server::scene_name("afm");
  served.one_tip_only = true;
  served.make_slave = [config, exchange = running_->exchange, &clock] {
    return std::make_unique<afm::AfmSlave>(config, exchange, clock);
  };
  return served;
}

void ServeAfm::stop() {
  running_.reset();
}

void add_afm_guard_command(CLI::App& app, int& exit_code) {
  CLI::App* const command = app.add_subcommand("afm-guard", "Started by serve --slave nanonis; not by hand");
  command->group("");
  auto emergency = std::make_shared<std::string>();
  auto silence_ms = std::make_shared<int>(400);
  command->add_option("--emergency", *emergency, "HOST:PORT")->required();
  command->add_option("--silence-ms", *silence_ms, "Of the server, before the guard withdraws the tip");
  command->callback([emergency, silence_ms, &exit_code] {
    exit_code = afm::run_guard(STDIN_FILENO, net::parse_address(*emergency, "--emergency"), *silence_ms);
  });
}

}  // namespace telenano::app

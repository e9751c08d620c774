#include <CLI/CLI.hpp>
#include <atomic>
#include <charconv>
#include <csignal>
#include <cstdio>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/base/version.h"
#include "telenano/common/config/completion.h"
#include "telenano/common/config/program.h"
#include "telenano/common/net/udp.h"
#include "telenano/common/rt/steady_clock.h"
#include "telenano/nve_server/afm_sim/default_scene.h"
#include "telenano/nve_server/afm_sim/sim_server.h"
#include "telenano/nve_server/app/serve/port_list.h"

namespace {

using namespace telenano;

std::atomic<bool> g_stop{false};
void on_signal(int) {
  g_stop.store(true, std::memory_order_relaxed);
}

struct Options {
  std::string scene;
  std::string listen = "127.0.0.1";
  std::string ports = "6501-6504";
  std::vector<std::string> faults;
  double faults_per_minute = 0;
  bool error_alone = false;
  afm_sim::SimConfig rig;
  std::string control_file;
};

void run(Options options) {
  const auto scene = options.scene.empty() ? afm_sim::default_scene() : scene::load_scene(options.scene);
  if (options.error_alone) options.rig.error_form = nanonis::ErrorForm::kAlone;
  if (options.rig.deflection_nm_v == 0)
    throw UserError("--deflection-nm-v: 0 is not possible; expected nm per volt");
  afm_sim::SimServerOptions server_options;
  for (const std::uint16_t port : app::parse_port_list(options.ports, "--ports"))
    server_options.ports.push_back(
        net::parse_address(options.listen + ":" + std::to_string(port), "--listen"));
  for (const std::string& text : options.faults)
    server_options.faults.push_back(afm_sim::parse_fault(text, "--fault"));
  const auto random = afm_sim::random_faults(options.rig.seed, options.faults_per_minute, 86400);
  server_options.faults.insert(server_options.faults.end(), random.begin(), random.end());
  server_options.control_file = options.control_file;
  const rt::SteadyClock clock;
  afm_sim::SimServer server(server_options, afm_sim::SimController(options.rig, scene), clock);

  struct sigaction action {};
  action.sa_handler = on_signal;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  std::string ports;
  for (const net::Address& local : server.local())
    ports += (ports.empty() ? "" : " ") + net::to_string(local);
  std::fprintf(stderr, "telenano-afm-sim: %s behind a controller on %s\n", scene->name.c_str(),
               ports.c_str());
  server.run(g_stop);
  const afm_sim::SimController& end = server.controller();
  std::fprintf(stderr,
               "telenano-afm-sim: stopped after %llu requests; tip %s at %.1f nm, force %.2f nN, "
               "greatest %.2f nN; SafeTip %llu times; %llu calls that move\n",
               static_cast<unsigned long long>(server.calls()), end.withdrawn() ? "withdrawn" : "out",
               end.height_nm(), end.tip().normal_force_nn(), server.greatest_nn(),
               static_cast<unsigned long long>(end.safe_tips()),
               static_cast<unsigned long long>(end.moves()));
}

}  // namespace

// What flags are made of throws for want of memory only. NOLINTNEXTLINE(bugprone-exception-escape)
int main(int argc, char** argv) {
  CLI::App app("A simulated AFM controller that speaks the Nanonis TCP protocol", "telenano-afm-sim");
  app.set_version_flag("--version", std::string("telenano-afm-sim ") + kVersion);
  int exit_code = 0;
  Options o;
  app.add_option("--scene", o.scene,
                 "Scene file (TOML): sample, probe, surface [flat silicon oxide, lever of 40 N/m]")
      ->type_name(config::kSceneOrFile);
  app.add_option("--listen", o.listen, "Address of this machine")->capture_default_str();
  app.add_option("--ports", o.ports,
                 "A range or a list of TCP ports, one client each; 0,0,0,0 takes any free ones")
      ->capture_default_str();
  app.add_option("--seed", o.rig.seed, "Seed of the noise and the random faults")->capture_default_str();
  app.add_option("--z-sign", o.rig.z_sign, "1: larger Z is away from the sample; -1: towards it")
      ->capture_default_str()
      ->check(CLI::IsMember({1, -1}));
  app.add_option("--deflection-nm-v", o.rig.deflection_nm_v, "Calibration of the photodiode, signed")
      ->capture_default_str()
      ->check(CLI::Range(-1e4, 1e4));
  app.add_option("--range-z-nm", o.rig.range_z_nm, "Range of the piezo along Z")
      ->capture_default_str()
      ->check(CLI::Range(50.0, 1e5));
  app.add_option("--range-xy-nm", o.rig.range_xy_nm, "Range of the piezo along X and Y")
      ->capture_default_str()
      ->check(CLI::Range(50.0, 1e6));
  app.add_option("--drift-nm-s", o.rig.drift_z_nm_s,
                 "Drift of the tip's height; negative: towards the sample")
      ->capture_default_str()
      ->check(CLI::Range(-100.0, 100.0));
  app.add_option("--noise", o.rig.noise_nm_sqrt_hz, "Noise of the deflection, nm/sqrt(Hz)")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 1.0));
  app.add_option("--creep", o.rig.creep, "Creep of the piezo: part of a move that comes late")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 0.2));
  app.add_option("--thermal-nm", o.rig.thermal_nm, "Slow bending of the lever with temperature, peak")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 100.0));
  app.add_option("--setpoint-nn", o.rig.setpoint_nn, "Set point of the Z controller")
      ->capture_default_str()
      ->check(CLI::Range(0.1, 1e4));
  app.add_option("--quantum-v", o.rig.quantum_v,
                 "Step of the converter: 3.05e-4 is 16 bits over +-10 V; 0: none")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 1.0));
  app.add_option("--safe-tip-signal", o.rig.safe_tip_signal,
                 "Signal that SafeTip watches; a negative number: with its sign changed")
      ->capture_default_str()
      ->check(CLI::Range(-31, 31));
  app.add_flag("--restrict-roles", o.rig.restrict_roles,
               "Ports take only what suits their role: motion, reads, data, emergency");
  app.add_flag("--error-alone", o.error_alone,
               "Send error replies without values, instead of values of zero");
  app.add_option("--fault", o.faults,
                 "'[@TIME] silent TIME', 'reset', 'garbage', 'slow TIME DELAY', 'sensor "
                 "frozen|high|low|noisy|inverted|swapped|good', 'dip DEPTH TIME', 'withdraw undone|half "
                 "N|ever'; may be "
                 "given more than once")
      ->type_name("TEXT");
  app.add_option("--faults-per-minute", o.faults_per_minute, "Random faults per minute, drawn from --seed")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 6000.0));
  app.add_option("--control", o.control_file,
                 "File of faults: each time it is written, the faults in it happen")
      ->type_name("FILE");
  app.footer(
      "Signals: 0 current, 8 deflection (m), 9 lateral (V), 30 Z (m). Ends on SIGINT or SIGTERM, and says "
      "where the tip is.");
  app.callback([&] { run(o); });
  return config::run_program(app, argc, argv, exit_code);
}

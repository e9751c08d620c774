#include "telenano/master/app/plan/plan_command.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>

#include "telenano/common/base/error.h"
#include "telenano/common/config/print.h"
#include "telenano/common/control/method_choice.h"
#include "telenano/common/link/client_session.h"
#include "telenano/common/net/udp.h"
#include "telenano/common/plot/gnuplot.h"
#include "telenano/master/app/access_flags.h"
#include "telenano/master/app/devices/session_device.h"
#include "telenano/master/app/link_probe.h"
#include "telenano/master/app/plan/plan_plot.h"
#include "telenano/master/app/plan/station_plan.h"
#include "telenano/master/app/plan/touch_forecast.h"
#include "telenano/master/app/run/scene_wait.h"
#include "telenano/master/app/run/server_scene.h"
#include "telenano/master/app/stop_signals.h"
#include "telenano/master/connection/connect.h"
#include "telenano/master/device/sim_device.h"
#include "telenano/master/scene/scene_keeper.h"
#include "telenano/master/twin/load_twin.h"

namespace telenano::app {
namespace {

// Half a second of idle commands, enough for a p99 at the usual rates.
constexpr double kProbeS = 0.5;
constexpr int kProbeMin = 20;
constexpr int kProbeMax = 500;
// As long as `run` waits for a twin that nobody asked for, twice: a forecast was asked for.
constexpr int kSceneWaitS = 16;

struct PlanOptions : connection::ServerAccess {
  PlanOptions() { server.clear(); }  // a server or a file of limits: neither is taken for granted

  std::string config_file;
  std::string limits;
  std::optional<std::string> device;
  std::optional<double> rate_hz;
  std::optional<std::string> method;
  std::optional<double> rtt_ms;
  Workspaces workspaces;
  std::string server_scene;
  bool felt = false;
  std::optional<double> compand;
  std::string plot;
};

/// What is planned for: a slave, and the way to it.
struct Far {
  config::SlaveLimits slave;
  LinkDelay link;                   ///< sent = 0: given, not measured
  std::vector<SceneChoice> scenes;  ///< of a server with several
  // With --felt:
  std::optional<TouchForecast> touch;
  std::string no_touch;   ///< why there is no forecast
  bool has_twin = false;  ///< `run` would feel the sample by a twin of the server's slave
};

void require_positive(const char* flag, const std::optional<double>& value) {
  if (value && !(std::isfinite(*value) && *value > 0))
    throw UserError(fmt::format("{}: {:g}, expected a finite number > 0", flag, *value));
}

// The file, then the flags, which win.
StationFile station_file(const PlanOptions& options) {
  StationFile file = options.config_file.empty() ? StationFile{} : load_station_file(options.config_file);
  if (options.rate_hz) file.station.rate_hz = *options.rate_hz;
  if (options.compand) file.station.companding.gain = *options.compand;
  if (options.method && *options.method == "auto") {
    file.chooses_method = true;
  } else if (options.method) {
    file.station.method = control::parse_method(*options.method);
  }
  if (options.workspaces.haptic_m) file.workspaces.haptic_m = options.workspaces.haptic_m;
  if (options.workspaces.visual_m) file.workspaces.visual_m = options.workspaces.visual_m;
  if (options.workspaces.nano_nm) file.workspaces.nano_nm = options.workspaces.nano_nm;
  finish_station_file(file, options.config_file.empty() ? "command line" : options.config_file);
  return file;
}

void validate(const PlanOptions& options) {
  if (options.server.empty() == options.limits.empty()) {
    throw UserError(
        "plan: give either --server HOST:PORT (a running telenano-nve serve) or --limits FILE (written by "
        "telenano-nve check --limits)");
  }
  if (options.felt && options.server.empty())
    throw UserError("--felt needs --server: it uses the server's sample, and a --limits file contains none");
  if (!options.server_scene.empty() && options.server.empty())
    throw UserError("--server-scene needs --server: it is one of that server's scenes");
  if (options.compand && !options.felt)
    throw UserError("--compand needs --felt: it acts on the sample's forces");
  if (options.rtt_ms && !(*options.rtt_ms >= 0 && *options.rtt_ms <= 60'000))
    throw UserError(fmt::format("--rtt-ms: {:g}, expected 0 to 60000", *options.rtt_ms));
  if (!std::isfinite(options.connect_timeout_s))
    throw UserError(fmt::format("--connect-timeout-s: {} is not a finite number", options.connect_timeout_s));
  require_positive("--haptic-m", options.workspaces.haptic_m);
  require_positive("--visual-m", options.workspaces.visual_m);
  require_positive("--nano-nm", options.workspaces.nano_nm);
}

/// Of --device, else of the station file's [device] where it is one that shows forces, else the simulated
/// one.
device::DeviceInfo device_info(const PlanOptions& options, const StationFile& file) {
  const DeviceSpec spec = parse_device_spec(options.device.value_or(file.device.kind));
  if (const auto device = planned_device(spec, file)) return *device;
  if (options.device)
    throw UserError(
        fmt::format("--device {}: shows no force, so there is nothing to plan; expected {}", *options.device,
                    any_of_text(device_names([](const DeviceRow& row) { return row.shows_force; }))));
  return device::sim_device_info(file.plant);
}

std::string on_its_way(const scene_store::SceneKeeper& keeper) {
  if (keeper.bundle() != nullptr) return "being checked";
  return fmt::format("being fetched: {:.0f} % is here", 100 * keeper.fetched());
}

/// The sample of the session, pressed here, not at the server.
void forecast(link::ClientSession& session, connection::ServerLink& way, const net::Address& server,
              const StationFile& file, scene_store::SceneKeeper& keeper, const std::atomic<bool>& stop,
              Far& far) {
  const link::Welcome& welcome = session.welcome();
  if (welcome.scene.empty()) {
    far.no_touch = "this server does not share its scene";
    return;
  }
  keeper.start();
  wait_for_scene(session, way, server, keeper, SceneWait::kLookedAt, kSceneWaitS, file.station.rate_hz, stop,
                 [&] { config::print(stderr, "note: the server's scene is {}\n", on_its_way(keeper)); });
  const auto scene = keeper.scene();
  if (!scene) {
    far.no_touch = keeper.settled() ? keeper.news().words
                                    : fmt::format("after {} s the server's scene is still {}; ask again",
                                                  kSceneWaitS, on_its_way(keeper));
    return;
  }
  const auto twins = twin::decode_twins(scene->bundle, 1);
  far.has_twin = scene->same_physics && session.logs_steps();
  far.touch = forecast_touch(*twins[0], file.task, welcome.start_pos_w_nm, welcome.surface_z_w_nm,
                             file.station.rate_hz, file.station.companding);
}

Far ask_server(const PlanOptions& options, const StationFile& file) {
  const double rate_hz = file.station.rate_hz;
  // Forks, so before whatever has threads, keys or sockets.
  std::optional<scene_store::SceneKeeper> keeper;
  if (options.felt) keeper.emplace(scene_store::SceneKeeperOptions{});
  const net::Address server = net::parse_address(options.server, "--server");
  const std::atomic<bool>& stop = catch_stop_signals();
  connection::ServerLink way(options, server);
  link::ClientConfig config;
  config.rate_hz = static_cast<std::uint32_t>(rate_hz);
  config.nonce_seed = connection::random_nonce_seed();
  // Whether steps are logged, which a twin needs, is agreed on with the session.
  if (options.felt) config.step_ring = static_cast<std::size_t>(rate_hz);
  link::ClientSession session(config);
  connection::connect(session, way, server, rate_hz, options, stop);
  const connection::Farewell farewell(session, way.datagram(), server);
  Far far;
  loop::ScenePipe none;
  loop::ScenePipe& pipe = keeper ? keeper->pipe() : none;
  far.scenes = list_scenes(session, way, server, pipe, stop);
  if (!options.server_scene.empty())
    choose_scene(session, way, server, pipe, options.server_scene, far.scenes, stop);
  far.slave = slave_limits(session.welcome());
  if (!options.rtt_ms) {
    far.link = measure_link(session, way, server, rate_hz,
                            std::clamp(static_cast<int>(kProbeS * rate_hz), kProbeMin, kProbeMax),
                            options.connect_timeout_s, stop);
  }
  if (keeper) forecast(session, way, server, file, *keeper, stop, far);
  return far;
}

Far ask(const PlanOptions& options, const StationFile& file) {
  const double rate_hz = file.station.rate_hz;
  Far far;
  if (options.limits.empty()) {
    far = ask_server(options, file);
  } else {
    far.slave = config::load_slave_limits(options.limits);
    if (rate_hz > far.slave.rate_max_hz) {
      throw UserError(fmt::format(
          "{}: this slave allows at most {:g} Hz, but the station asks for {:g} Hz; lower --rate (rate_hz)",
          options.limits, far.slave.rate_max_hz, rate_hz));
    }
  }
  if (far.link.sent == 0) far.link.median_s = far.link.p99_s = 1e-3 * options.rtt_ms.value_or(0);
  return far;
}

const char* binding_name(control::BindingLimit limit) {
  switch (limit) {
    case control::BindingLimit::kPassivity:
      return "passivity";
    case control::BindingLimit::kDevice:
      return "device";
    case control::BindingLimit::kNothing:
      break;
  }
  return "nothing_is_safe";
}

void print_table(const StationFile& file, const Far& far, const control::ScalingPlanInput& in,
                 const control::ScalingPlan& plan, const control::ScalingPlan& at_p99,
                 const control::ScalingPlanInput& in_p99) {
  const auto row = [](const char* key, double value, const char* unit) {
    config::print(stdout, "{},{:.15g},{}\n", key, value, unit);
  };
  const auto word = [](const char* key, const std::string& value) {
    config::print(stdout, "{},{},\n", key, value);
  };
  std::puts("key,value,unit");
  word("method", std::string(control::method_name(in.method)));
  for (std::size_t i = 0; i < far.scenes.size(); ++i)
    word(fmt::format("scene_{}", i + 1).c_str(), far.scenes[i].name);
  row("rate", file.station.rate_hz, "Hz");
  row("device_damping", in.plant.device_damping_n_s_m, "N s/m");
  row("device_force_max", in.device_force_max_n, "N");
  row("force_safety", in.force_safety, "1");
  row("tip_force_max", in.tip_force_max_nn, "nN");
  row("coupling_stiffness", in.plant.coupling_stiffness_n_m, "N/m");
  row("coupling_damping", in.plant.coupling_damping_n_s_m, "N s/m");
  row("round_trip_median", 1e3 * far.link.median_s, "ms");
  row("round_trip_p99", 1e3 * far.link.p99_s, "ms");
  row("round_trips_measured", far.link.answered, "1");
  row("loop_delay", in.plant.delay_samples, "samples");
  row("loop_delay_p99", in_p99.plant.delay_samples, "samples");
  row("binding_delay", plan.binding_delay_samples, "samples");
  row("haptic_workspace", in.haptic_workspace_m, "m");
  row("visual_workspace", in.visual_workspace_m, "m");
  row("nano_workspace", in.nano_workspace_nm, "nm");
  row("haptic_to_visual", plan.haptic_to_visual, "1");
  row("visual_to_nano", plan.visual_to_nano, "1");
  row("force_scale_published", plan.published_force_scale, "1");
  row("force_scale_no_delay", plan.sampled_force_scale, "1");
  row("force_scale_loop_delay", plan.delayed_force_scale, "1");
  row("force_scale_loop_delay_p99", at_p99.delayed_force_scale, "1");
  row("force_scale_passive", plan.passive_force_scale, "1");
  row("force_scale_device", plan.device_force_scale, "1");
  row("force_scale_case_1", plan.case_one_force_scale, "1");
  word("case_1_safe", plan.case_one_safe ? "yes" : "no");
  row("force_scale_case_2", plan.case_two_force_scale, "1");
  word("case_2_safe", plan.case_two_safe ? "yes" : "no");
  row("passive_wall", plan.passive_wall_n_m, "N/m");
  row("passive_wall_loop_delay", plan.delayed_wall_n_m, "N/m");
  word("binding", binding_name(plan.binding));
  row("recommended_velocity_scale", plan.scaling.velocity, "1");
  row("recommended_force_scale", plan.scaling.force, "1");
  row("shown_stiffness", plan.shown_stiffness_n_m, "N/m");
  row("felt_force_max", plan.felt_force_max_n, "N");
}

/// As a value of the table: some of the words are a scene's.
std::string one_value(std::string words) {
  for (char& c : words) {
    if (c == ',') c = ';';
    if (static_cast<unsigned char>(c) < ' ') c = ' ';
  }
  return words;
}

double felt_n(double tip_nn, const control::ScalingPlan& plan) {
  return std::min(tip_nn * 1e-9 * plan.scaling.force, plan.felt_force_max_n);
}

void print_felt(const StationFile& file, const Far& far, const control::ScalingPlan& plan) {
  config::print(stdout, "scene,{},\n", far.slave.scene_name);
  config::print(stdout, "felt_per_nanonewton,{:.15g},N/nN\n", 1e-9 * plan.scaling.force);
  if (!far.touch) {
    config::print(stdout, "felt,unknown,\nfelt_unknown_because,{},\n", one_value(far.no_touch));
    config::print(stderr, "felt: not known, {}\n", far.no_touch);
    return;
  }
  config::print(stdout, "felt,{},\n", far.touch->touched ? "touch" : "no_touch");
  config::print(stdout, "press_depth,{:.15g},nm\n", file.task.depth_nm);
  config::print(stdout, "press_force,{:.15g},nN\n", far.touch->push_nn);
  config::print(stdout, "felt_press,{:.15g},N\n", felt_n(far.touch->push_nn, plan));
  config::print(stdout, "pull_off_force,{:.15g},nN\n", far.touch->pull_off_nn);
  config::print(stdout, "felt_pull_off,{:.15g},N\n", felt_n(far.touch->pull_off_nn, plan));
  config::print(stderr,
                "felt: {:.3g} N for a nanonewton at the tip; pressed {:g} nm by a stiff hand {:.2g} N "
                "({:.3g} nN), pull-off {:.2g} N ({:.3g} nN)\n",
                1e-9 * plan.scaling.force, file.task.depth_nm, felt_n(far.touch->push_nn, plan),
                far.touch->push_nn, felt_n(far.touch->pull_off_nn, plan), far.touch->pull_off_nn);
}

/// What a hand can tell of the attraction before contact, with and without companding.
void print_far(const StationFile& file, const Far& far, const control::ScalingPlan& plan) {
  if (!far.touch) return;
  const double n_per_nn = 1e-9 * plan.scaling.force;
  const control::CompandingConfig& companding = file.station.companding;
  const Noticed plain = noticed(far.touch->way_in, n_per_nn, false);
  const Noticed shown = noticed(far.touch->way_in, n_per_nn, true);
  const auto row = [](const char* key, double value, const char* unit) {
    config::print(stdout, "{},{:.15g},{}\n", key, value, unit);
  };
  row("felt_far", plain.most_n, "N");
  row("felt_far_from", plain.from_nm, "nm");
  row("felt_far_differences", plain.differences, "1");
  row("companding_gain", companding.gain, "1");
  if (!companding.on()) return;
  row("companded_far", shown.most_n, "N");
  row("companded_far_from", shown.from_nm, "nm");
  row("companded_far_differences", shown.differences, "1");
  row("companding_energy", 1e3 * plan.scaling.hand_energy_j(companding.most_aj()), "mJ");
  config::print(
      stderr,
      "before contact: attraction up to {:.2g} N, noticed from {:.3g} nm, {:.0f} just noticeable "
      "differences; companded {:g} times: {:.2g} N, {:.3g} nm, {:.0f}; the stiffness that pushes back is "
      "as planned, and a hand may get {:.3g} mJ more\n",
      plain.most_n, plain.from_nm, plain.differences, companding.gain, shown.most_n, shown.from_nm,
      shown.differences, 1e3 * plan.scaling.hand_energy_j(companding.most_aj()));
}

std::string samples(double count) {
  return fmt::format("{:.4g} sample{} of delay", count, count == 1 ? "" : "s");
}

void print_text(const StationFile& file, const device::DeviceInfo& device, const Far& far,
                const control::ScalingPlanInput& in, const control::ScalingPlan& plan,
                const control::ScalingPlan& at_p99, const control::ScalingPlanInput& in_p99) {
  config::print(stderr, "plan for '{}': device {}, {:g} Hz, method {}; round trip {:.3g} ms ({}), {}\n",
                far.slave.scene_name, device.name, file.station.rate_hz, control::method_name(in.method),
                1e3 * far.link.median_s,
                far.link.sent > 0 ? fmt::format("median of {} of {} answered, p99 {:.3g} ms",
                                                far.link.answered, far.link.sent, 1e3 * far.link.p99_s)
                                  : "given",
                samples(in.plant.delay_samples));
  config::print(stderr, "{}\n", damping_text(file, device));
  config::print(
      stderr,
      "velocity scale: {:.4g} mm at the hand, {:.4g} mm in the picture, {:.4g} nm at the tip: 1/(k k') = "
      "1/({:.4g} x {:.4g}) = {:.4g}\n",
      1e3 * in.haptic_workspace_m, 1e3 * in.visual_workspace_m, in.nano_workspace_nm, plan.haptic_to_visual,
      plan.visual_to_nano, plan.scaling.velocity);
  config::print(stderr, "force scale: up to {:.4g} passively ({} for {}), up to {:.4g} by the device's force",
                plan.passive_force_scale, samples(plan.binding_delay_samples),
                control::method_name(in.method), plan.device_force_scale);
  if (plan.sampled_force_scale > 0) {
    config::print(stderr, "; as published (Llewellyn) {:.4g}, {:.3g} times what is exact without delay",
                  plan.published_force_scale, plan.published_force_scale / plan.sampled_force_scale);
  }
  config::print(stderr, "\n");
  const auto told = [](bool safe) { return safe ? "within the region" : "beyond the region"; };
  config::print(stderr, "Kim and Sitti's case I, 1/alpha_v = {:.4g}: {}; case II, 1/alpha_v^2 = {:.4g}: {}\n",
                plan.case_one_force_scale, told(plan.case_one_safe), plan.case_two_force_scale,
                told(plan.case_two_safe));
  config::print(stderr,
                "Z-width: this device shows a pure spring of {:.4g} N/m passively, {:.4g} N/m with {}\n",
                plan.passive_wall_n_m, plan.delayed_wall_n_m, samples(in.plant.delay_samples));
  if (in_p99.plant.delay_samples > in.plant.delay_samples) {
    config::print(stderr,
                  "note: one answer in a hundred takes {}; were it all of them, the loop alone would be "
                  "passive up to {:.4g}\n",
                  samples(in_p99.plant.delay_samples), at_p99.delayed_force_scale);
  }
  const std::string reason = control::plan_reason(in, plan);
  if (plan.binding == control::BindingLimit::kNothing) {
    config::print(stderr, "recommended: nothing; {}\n", reason);
  } else {
    config::print(stderr,
                  "recommended: --velocity-scale {:.4g} --force-scale {}, which shows {:.4g} N/m and at most "
                  "{:.3g} N; {}\n",
                  plan.scaling.velocity, fmt::format("{:.4g}", plan.scaling.force * (1 - 5e-4)),
                  plan.shown_stiffness_n_m, plan.felt_force_max_n, reason);
    station::StationConfig recommended = file.station;
    recommended.scaling = plan.scaling;
    const auto check =
        station::check_scaling(recommended, device, slave_port(far.slave), in.plant.delay_samples);
    if (!check.note.empty()) config::print(stderr, "note: {}\n", check.note);
  }
  if (!file.scaling.velocity && !file.scaling.force) return;
  station::StationConfig asked = file.station;
  if (!file.scaling.velocity) asked.scaling.velocity = plan.scaling.velocity;
  if (!file.scaling.force) asked.scaling.force = plan.scaling.force;
  const auto check = station::check_scaling(asked, device, slave_port(far.slave), in.plant.delay_samples);
  config::print(stderr, "as the station file has it: {}{}{}\n", check.text, check.safe ? "" : "; ",
                check.advice);
}

void plan(const PlanOptions& options) {
  validate(options);
  StationFile file = station_file(options);
  if (!options.plot.empty()) plot::require_drawable(options.plot, "--plot");
  const Far far = ask(options, file);
  if (options.method && *options.method == "auto")
    file.station.method =
        control::MethodChoice::at_start({far.link.median_s, 0, true, far.has_twin, far.link.measures});
  const device::DeviceInfo device = device_info(options, file);
  const double period_s = 1 / file.station.rate_hz;
  const control::ScalingPlanInput input =
      plan_input(file, device, far.slave, control::loop_delay_samples(far.link.median_s, period_s));
  control::ScalingPlanInput input_p99 = input;
  input_p99.plant.delay_samples = control::loop_delay_samples(far.link.p99_s, period_s);
  const control::ScalingPlan result = control::plan_scaling(input);
  const control::ScalingPlan at_p99 = control::plan_scaling(input_p99);
  print_table(file, far, input, result, at_p99, input_p99);
  if (options.felt) {
    print_felt(file, far, result);
    print_far(file, far, result);
  }
  print_text(file, device, far, input, result, at_p99, input_p99);
  if (options.plot.empty()) return;
  draw_plan(input, result,
            fmt::format("Scaling for {}: {:g} Hz, {}{}", far.slave.scene_name, file.station.rate_hz,
                        samples(input.plant.delay_samples),
                        result.binding == control::BindingLimit::kNothing ? ": nothing is safe" : ""),
            options.plot);
}

}  // namespace

void add_plan_command(CLI::App& app) {
  auto options = std::make_shared<PlanOptions>();
  CLI::App* const command = app.add_subcommand(
      "plan", "Plan the scaling for this station, link and slave, with reasons: CSV, text, a picture");
  command->add_option("--station,--config", options->config_file, "Station file (TOML); flags win over it");
  command->add_option("--server", options->server,
                      "HOST:PORT of telenano-nve serve: its limits are used and the round trip is measured");
  command
      ->add_option(
          "--server-scene", options->server_scene,
          "Scene to plan for, if the server has several (default: its first); the rows scene_* list them")
      ->type_name("NAME");
  command->add_option("--limits", options->limits,
                      "Instead of --server: limits of a slave, written by telenano-nve check --limits");
  command
      ->add_option("--device", options->device,
                   "Haptic device to plan for (default: [device] of the station file, else sim)")
      ->type_name(choices_text(device_names([](const DeviceRow& row) { return row.shows_force; })));
  command->add_option("--rtt-ms", options->rtt_ms,
                      "Round trip to plan for (default: measured with --server, 0 with --limits)");
  command->add_option("--rate", options->rate_hz, "Hz of the station's loop (default 1000)")
      ->check(CLI::Range(100.0, 8000.0));
  command
      ->add_option("--method", options->method,
                   "Control method that keeps the session passive, see run --help")
      ->type_name("{auto,none,ks,ks-clamp,tdpa,wave,tank,model,twin}");
  command->add_flag(
      "--felt", options->felt,
      "Also compute what the hand will feel, by pressing on a local copy of the server's scene: "
      "rows felt_*");
  command->add_option("--compand", options->compand,
                      "With --felt: also show weak attraction up to this many times as strong, 1 to 10");
  command->add_option("--haptic-m", options->workspaces.haptic_m,
                      "Edge length of the hand's workspace (default: the device's)");
  command->add_option("--visual-m", options->workspaces.visual_m,
                      "Edge length of the picture (default: 0.3)");
  command->add_option("--nano-nm", options->workspaces.nano_nm,
                      "Edge length of the tip's workspace (default: the shortest of the slave)");
  command->add_option("--plot", options->plot, "FILE.svg or FILE.png: plot the allowed region with gnuplot");
  add_access_flags(*command, *options);
  command->footer(
      "CSV on standard output (key,value,unit), the plan as text on standard error. `run` uses the "
      "same plan for\nevery scale that neither its station file nor its flags set.");
  command->callback([options] { plan(*options); });
}

}  // namespace telenano::app

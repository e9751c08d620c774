#include "telenano/master/app/run/run_command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>

#include "telenano/common/base/error.h"
#include "telenano/common/config/print.h"
#include "telenano/master/app/access_flags.h"
#include "telenano/master/app/devices/device_kinds.h"
#include "telenano/master/app/run/next_run.h"
#include "telenano/master/app/run/run_options.h"
#include "telenano/master/app/run/run_session.h"
#include "telenano/master/app/station_file.h"

namespace telenano::app {
namespace {

/// What a session needs whatever moves the hand.
void add_session_flags(CLI::App& command, RunOptions& options) {
  command
      .add_option("--server", options.server,
                  "HOST:PORT of telenano-nve serve, or several, A,B: the first that accepts the session is "
                  "used, and the next if the connection is lost")
      ->capture_default_str();
  add_access_flags(command, options);
  command.add_option("--station,--config", options.config_file, "Station file (TOML); flags win over it");
  command.add_option("--rate,--rate-hz", options.rate_hz, "Hz of the station's loop (default 1000)")
      ->check(CLI::Range(100.0, 8000.0));
  command
      .add_option(
          "--method", options.method,
          "Control method that keeps the session passive (default: auto: twin if the server shares "
          "its scene and logs steps, else model for an AFM, else tank or model, depending on the round "
          "trip)")
      ->type_name("{auto,none,ks,ks-clamp,tdpa,wave,tank,model,twin}");
  command.add_option("--scene", options.scene,
                     "The server's scene, a name or a file: the station simulates it locally, so that the "
                     "hand feels the sample without delay (method twin)");
  command
      .add_option(
          "--server-scene", options.server_scene,
          "Scene to work in, if the server has several (default: its first); the names are printed when "
          "the session begins")
      ->type_name("NAME");
  command.add_option("--velocity-scale", options.velocity_scale,
                     "Velocity scale alpha_v, tip metres per hand metre (default: planned, see plan)");
  command.add_option("--force-scale", options.force_scale,
                     "Force scale alpha_F, hand newtons per tip newton (default: planned, see plan)");
  command.add_option("--compand", options.compand,
                     "Amplify weak attraction before contact by up to this factor, 1 to 10 (default: 1, "
                     "unchanged); felt with method twin, see [companding] in deploy/station.toml");
  command.add_flag("--allow-unsafe-scaling", options.allow_unsafe_scaling,
                   "Allow a scaling that the device cannot show passively; the force limits still apply");
  command
      .add_option("--redundancy", options.redundancy,
                  "Number of earlier commands repeated in each datagram, so that the slave gets the whole "
                  "path over a lossy link (default: 0)")
      ->check(CLI::Range(0, 4));
  command
      .add_option("--reply-deadband", options.reply_deadband_permille,
                  "Let the server leave out a reply if its force differs by less than this from the last one "
                  "sent, in thousandths of that force; 0: send all. Default: up to the station file's "
                  "value, while the link is full and nothing is recorded. Not with a twin")
      ->type_name("PERMILLE")
      ->check(CLI::Range(0.0, kReplyDeadbandMost_permille));
  command
      .add_option("--send-hz", options.send_hz,
                  "Datagrams per second: auto (default): as many as the link carries without queueing, at "
                  "most one per tick; or a fixed number")
      ->type_name("{auto,20-8000}");
  command
      .add_option("--dscp", options.dscp,
                  "DSCP marking of outgoing packets, for routers that use it: ef (46, expedited forwarding), "
                  "none, 0-63")
      ->capture_default_str();
  command
      .add_option("--undo-marks-at", options.undo_marks_at_s,
                  "Undo the last stroke of marks at this time of the session, s; the tip must be off the "
                  "sample then. In the window: U")
      ->check(CLI::Range(0.001, 1e6));
  command
      .add_option_function<std::string>(
          "--practice-link",
          [&options](const std::string& text) {
            options.practice = link::parse_practice_link(text, "--practice-link");
          },
          "Simulate a worse link for practice: round trip and jitter to add (ms), loss in each direction "
          "(percent); off: only show the sliders in the window. Also delays a stop, so not for a real AFM")
      ->type_name("{off,rtt=100,jitter=5,loss=2}");
  command
      .add_option("--metrics", options.metrics,
                  "Serve Prometheus metrics at HOST:PORT, e.g. 127.0.0.1:9464; port 0: any free port")
      ->type_name("HOST:PORT");
  command.add_flag("--metrics-public", options.metrics_public,
                   "Allow --metrics on a non-loopback address, where anyone can read it");
  command.add_option("--record", options.record, "Write a recording (HDF5) to this file");
  command.add_flag("--overwrite", options.overwrite, "Replace the recording if it exists");
  command
      .add_option("--rt-priority", options.realtime_priority,
                  "SCHED_FIFO priority of the loop; 0: normal scheduling")
      ->capture_default_str()
      ->check(CLI::Range(0, 99));
  command.add_option("--rt-cpu", options.realtime_cpu, "Processor that runs the loop (default: any)")
      ->check(CLI::Range(0, 1023));
  command.add_flag("--cpu-awake", options.cpu_awake,
                   "Keep the processors out of deep sleep: they wake in a few microseconds, but produce more "
                   "heat");
  command
      .add_option("--give-up-s", options.give_up_s, "End the session if the server is silent for this long")
      ->capture_default_str()
      ->check(CLI::Range(0.5, 86400.0));
  add_view_flags(command, options.view);
  CLI::Option* const observe = command.add_flag(
      "--observe", options.observe,
      "With a shared tip (serve --share one-tip): observe and never hold it, until stopped or for "
      "--duration-s");
  command
      .add_flag("--take-over", options.take_over,
                "With a shared tip: ask for it, and get it as soon as it is free or its holder lets go, or "
                "at once with the right to administer")
      ->excludes(observe);
  command.add_flag("--close-at-end", options.close_at_end,
                   "Close the window when the session ends, for whatever reason (default: at a terminal it "
                   "stays and shows a summary)");
  command.add_flag("--quiet", options.quiet, "Print no progress, only the summary");
  command.footer(
      "Exit code: 0 the task is done, or was stopped by a signal; 1 failed while running (no "
      "server, server silent for too\nlong, the station stopped itself, or the recording is "
      "incomplete; a full disk does not end the session); 2 wrong usage or\nconfiguration, and "
      "nothing was written.");
}

/// One session after the other, for as long as a person wants.
int run_sessions(const RunOptions& options) {
  std::optional<NextRun> next;
  int exit_code = 1;
  try {
    exit_code = run_session(options, next);
  } catch (const RunError& error) {
    if (!next || !next->asked()) throw;
    config::print(stderr, "telenano-master: {}\n", error.what());
  }
  if (next && next->asked()) throw RunError(next->begin());
  return exit_code;
}

}  // namespace

CLI::App* add_run_command(CLI::App& app, const std::string& command_line, int& exit_code) {
  auto options = std::make_shared<RunOptions>();
  options->command_line = command_line;
  CLI::App* const command = app.add_subcommand("run", "Run one session with a server: feel its sample");
  command
      ->add_option("--device", options->device,
                   "Haptic device (default: sim); 'devices' lists those attached")
      ->type_name(choices_text(device_names([](const DeviceRow&) { return true; })));
  command->add_flag("--home", options->home,
                    "Let the omega calibrate itself with its motors: IT MOVES, keep hands and objects clear");
  command
      ->add_option(
          "--task", options->task,
          "What the simulated hand does; in a window you can choose another task later. Without this "
          "and --duration-s the session continues after the task")
      ->capture_default_str()
      ->type_name("{position,contact,indent,scan,script}")
      ->each([options](const std::string&) { options->task_given = true; });
  command->add_option("--script", options->script,
                      "CSV with t_s,x_nm,y_nm,z_nm for --task script; z above the surface");
  command
      ->add_option("--duration-s", options->duration_s,
                   "Duration of the task (default: 10), or of a session with a real device (default: until "
                   "stopped); a task that cannot begin is given up after as long")
      ->check(CLI::Range(0.5, 3600.0));
  command->add_option("--depth-nm", options->depth_nm, "Intended depth of --task indent (default 5)")
      ->check(CLI::Range(0.0, 1000.0));
  add_session_flags(*command, *options);
  command->callback([options, &exit_code] { exit_code = run_sessions(*options); });
  return command;
}

CLI::App* add_replay_command(CLI::App& app, const std::string& command_line, int& exit_code) {
  auto options = std::make_shared<RunOptions>();
  options->command_line = command_line;
  CLI::App* const command = app.add_subcommand(
      "replay", "Repeat the hand's motion of a recording with any server, like run --device replay:FILE");
  auto file = std::make_shared<std::string>();
  command->add_option("FILE", *file, "recording")->required();
  add_session_flags(*command, *options);
  command->callback([options, file, &exit_code] {
    options->device = "replay:" + *file;
    exit_code = run_sessions(*options);
  });
  return command;
}

}  // namespace telenano::app

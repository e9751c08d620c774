#include "telenano/common/config/completion.h"

#include <CLI/CLI.hpp>
#include "telenano/master/app/view/session_view.h"

namespace telenano::app {

void add_picture_flags(CLI::App& command, ViewOptions& options, const std::string& at) {
  command
      .add_option("--surface", options.surface,
                  "Scan to draw: the .gsf of the server's scene, or the scene's name; read again when it "
                  "changes. Default: the scan that the server offers, else a plane and the places touched")
      ->type_name(config::kSceneOrFile);
  command
      .add_option(
          "--tip-radius-nm", options.tip_radius_nm,
          "Radius of the tip as drawn. Default: that of the scene, where it is known (shared by the server, "
          "in the recording, or a file here), else 20, and the picture says that it is assumed")
      ->check(CLI::Range(0.5, 10000.0));
  command
      .add_option("--text-size", options.text_size,
                  "Text size in the window, relative to the screen's own; change it there with Ctrl and plus "
                  "or minus")
      ->capture_default_str()
      ->check(CLI::Range(0.75, 2.5));
  command.add_option("--screenshot", options.screenshot,
                     "Save one picture of the session as this PNG; needs neither display nor graphics card");
  command.add_option("--at", options.at_s, at)
      ->capture_default_str()
      ->check(CLI::Range(0.0, 86400.0))
      ->needs("--screenshot");
  command.add_option("--screenshot-size", options.screenshot_size, "WIDTHxHEIGHT of --screenshot, pixels")
      ->capture_default_str()
      ->needs("--screenshot");
}

void add_view_flags(CLI::App& command, ViewOptions& options) {
  command.add_flag(
      "--view", options.view,
      "Open a window: sample, tip, forces, sliders, STOP; F1 lists its keys. Default with --device "
      "mouse");
  command.add_flag("--no-view", options.no_view, "Open no window, with any device")->excludes("--view");
  command.add_flag(
      "--guide", options.guide,
      "In the window: five steps from a first touch to a pull-off; G switches the guide on and off");
  add_picture_flags(command, options, "Seconds of the hand's motion after which --screenshot is taken");
  command.get_option("--screenshot")->excludes("--view");
}

}  // namespace telenano::app

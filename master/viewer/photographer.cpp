#include "telenano/master/viewer/photographer.h"

#include <chrono>
#include <thread>
#include <utility>

#include "telenano/master/viewer/gl.h"
#include "telenano/master/viewer/offscreen.h"
#include "telenano/master/viewer/viewer.h"

namespace telenano::viewer {
namespace {

constexpr auto kPause = std::chrono::milliseconds(20);
constexpr int kSmoothing = 4;  // places a pixel
constexpr int kFrames = 120;   // until the close-up stands still: 0.88^120 of its way is left
constexpr double kFrameS = 1.0 / 60;

}  // namespace

Picture draw_picture(Viewer& viewer, int width_px, int height_px, const RecordingStatus& recording) {
  const Canvas canvas(width_px, height_px, kSmoothing);
  ImGui::GetIO().DeltaTime = static_cast<float>(kFrameS);
  viewer.settle(kFrames);
  // Twice: ImGui knows the sizes of its windows only after a first frame.
  for (int i = 0; i < 2; ++i) {
    canvas.bind();
    viewer.draw(width_px, height_px, i * kFrameS, recording);
  }
  return {width_px, height_px, canvas.read_rgb()};
}

void photograph(const ViewFacts& facts, view_model::Ground ground, view_model::ViewPort& port,
                const ViewHooks& hooks, const PhotoOptions& options, const std::function<double()>& time_s) {
  const OffscreenContext context;
  Viewer viewer(facts, std::move(ground), port, 1);
  bool taken = false;
  while (true) {
    const bool over = hooks.session_over();
    const bool now = !taken && (over || time_s() >= options.at_s);
    if (now && hooks.changed_ground) {
      // Before the samples: their gap is that to the ground.
      if (auto changed = hooks.changed_ground()) viewer.set_ground(std::move(*changed));
    }
    if (now && hooks.server_scene) viewer.set_server_scene(hooks.server_scene(), 0);
    viewer.take_samples();
    if (now) {
      taken = true;
      write_png(options.file, draw_picture(viewer, options.width_px, options.height_px, hooks.recording()));
    }
    if (over) return;
    std::this_thread::sleep_for(kPause);
  }
}

void photograph_recording(const ViewFacts& facts, view_model::Ground ground, view_model::Playback& playback,
                          const PhotoOptions& options) {
  const OffscreenContext context;
  view_model::ViewPort port;
  Viewer viewer(facts, std::move(ground), port, 1);
  playback.play(false);
  playback.seek(options.at_s);
  viewer.play(playback);
  {
    // What follows the tip needs to know where it is before it can settle.
    const Canvas canvas(options.width_px, options.height_px, 0);
    canvas.bind();
    viewer.draw(options.width_px, options.height_px, kFrameS, {});
  }
  write_png(options.file, draw_picture(viewer, options.width_px, options.height_px, {}));
}

}  // namespace telenano::viewer

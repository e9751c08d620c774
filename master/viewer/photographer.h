#pragma once

#include <functional>
#include <string>

#include "telenano/master/view_model/view_port.h"
#include "telenano/master/viewer/png.h"
#include "telenano/master/viewer/view_hooks.h"

namespace telenano::viewer {

struct PhotoOptions {
  std::string file;
  double at_s = 5;  ///< after the hand's motion began; one after the session's end: at its end
  int width_px = 1280;
  int height_px = 800;
};

/// One picture of a session, without a display; the session goes on. Returns when the session is over.
/// `time_s` says how long the motion has gone. Throws RunError when this machine cannot draw or the file not
/// be written.
void photograph(const ViewFacts& facts, view_model::Ground ground, view_model::ViewPort& port,
                const ViewHooks& hooks, const PhotoOptions& options, const std::function<double()>& time_s);

/// One picture of a recording at `at_s` of its own time.
void photograph_recording(const ViewFacts& facts, view_model::Ground ground, view_model::Playback& playback,
                          const PhotoOptions& options);

class Viewer;
/// A few frames, so that what follows the tip has arrived, with edges smoothed where the driver can.
Picture draw_picture(Viewer& viewer, int width_px, int height_px, const RecordingStatus& recording);

}  // namespace telenano::viewer

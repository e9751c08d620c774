#pragma once

#include "telenano/master/view_model/playback.h"
#include "telenano/master/viewer/gui.h"
#include "telenano/master/viewer/layout.h"

namespace telenano::viewer {

/// Play, halt, move about, speed; in place of STOP where a recording is shown. Takes its keys too.
void draw_playback(const Gui& gui, view_model::Playback& playback);
void playback_keys(view_model::Playback& playback);

}  // namespace telenano::viewer

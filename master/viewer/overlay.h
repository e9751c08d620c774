#pragma once

#include "telenano/master/station/twin_run.h"
#include "telenano/master/view_model/live_session.h"
#include "telenano/master/view_model/profile.h"
#include "telenano/master/viewer/gui.h"
#include "telenano/master/viewer/scene_renderer.h"
#include "telenano/master/viewer/scene_state.h"
#include "telenano/master/viewer/view_facts.h"

namespace telenano::viewer {

/// Words and marks over the pictures: axes, scale bars, the legend of heights, gap and force where they are.
void draw_overview_text(const Gui& gui, const ViewFacts& facts, const SceneState& state,
                        const view_model::LiveSession& live, const view_model::Camera& camera,
                        const SceneFrame& frame, const Area& area);
void draw_close_up_text(const Gui& gui, const SceneState& state, const view_model::LiveSession& live,
                        const view_model::Camera& camera, const SceneFrame& frame, const Area& area);

/// The line of a measurement, on the ground, with its ends' names.
void draw_measurement(const Gui& gui, const view_model::Profile& profile, const view_model::Camera& camera,
                      const SceneFrame& frame, const Area& area);

/// The badges of the session banner (SIM, AFM, STALE …), the sample's name and what the station is doing,
/// across the top. Before the words of the pictures, which give way to it.
void draw_banner(const Gui& gui, const ViewFacts& facts, const view_model::LiveSession& live,
                 const Area& area, bool ended, station::TwinState twin, const std::string& practice);

}  // namespace telenano::viewer

#pragma once

#include <functional>
#include <memory>
#include <optional>

#include "telenano/common/surface/height_grid.h"
#include "telenano/master/app/run/mark_rows.h"
#include "telenano/master/scene/scene_keeper.h"
#include "telenano/master/station/station.h"
#include "telenano/master/view_model/server_scene.h"

namespace telenano::app {

/// The surface of the scene that is here, each time that it is another one than `shown`; without heights: a
/// plane again.
std::optional<surface::HeightGrid> newest_scene_ground(const scene_store::SceneKeeper& keeper,
                                                       std::shared_ptr<const surface::HeightGrid>& shown);

/// The surface with its marks as the twin has it, where it keeps some, else that of the scene that is here:
/// each time that it is another one. A flat one without marks is a plane as it is.
std::function<std::optional<surface::HeightGrid>()> newest_ground(const scene_store::SceneKeeper& keeper,
                                                                  const station::Station& station);

/// What the recording is told of marks, of the same samples as newest_ground().
/// What the window tells of the scene. `local_tip_radius_nm`: of a file here that is the scene; 0: there is none.
view_model::ServerScene shown_scene(const scene_store::SceneKeeper& keeper, double local_tip_radius_nm = 0);

MarkRows::Sample marked_sample(const scene_store::SceneKeeper& keeper, const station::Station& station);

}  // namespace telenano::app

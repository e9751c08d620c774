#include "telenano/master/app/run/shown_ground.h"

#include <cstdint>
#include <utility>

#include "telenano/common/surface/height_view.h"

namespace telenano::app {

std::optional<surface::HeightGrid> newest_scene_ground(const scene_store::SceneKeeper& keeper,
                                                       std::shared_ptr<const surface::HeightGrid>& shown) {
  const auto ground = keeper.ground();
  if (ground == shown) return std::nullopt;
  const bool flat = ground == nullptr || ground->z_nm.empty();
  const bool was_flat = shown == nullptr || shown->z_nm.empty();
  shown = ground;
  if (flat && was_flat) return std::nullopt;
  return flat ? surface::HeightGrid{} : *ground;
}

std::function<std::optional<surface::HeightGrid>()> newest_ground(const scene_store::SceneKeeper& keeper,
                                                                  const station::Station& station) {
  return [&keeper, &station, shown = std::shared_ptr<const surface::HeightGrid>(),
          seen = std::pair<const surface::HeightView*, std::uint64_t>()]() mutable
         -> std::optional<surface::HeightGrid> {
    const station::TwinRun* const twin = station.twin();
    const surface::HeightView* const marked = twin != nullptr ? twin->heights() : nullptr;
    const std::pair now(marked, marked != nullptr ? marked->version() : 0);
    if (marked != nullptr && (now.second > 0 || seen.second > 0)) {
      if (now == seen) return std::nullopt;
      seen = now;
      return marked->heights();
    }
    return newest_scene_ground(keeper, shown);
  };
}

view_model::ServerScene shown_scene(const scene_store::SceneKeeper& keeper, double local_tip_radius_nm) {
  using Check = scene_store::SceneNews::Check;
  scene_store::SceneNews news = keeper.news();
  view_model::ServerScene scene;
  scene.tip_radius_nm = news.tip_radius_nm > 0 ? news.tip_radius_nm : local_tip_radius_nm;
  scene.words = std::move(news.words);
  if (news.check == Check::kGoesOn) scene.note = "the server's scene is still being checked";
  if (news.check == Check::kUnusable) scene.note = "the server's scene cannot be used";
  return scene;
}

MarkRows::Sample marked_sample(const scene_store::SceneKeeper& keeper, const station::Station& station) {
  return {[&station]() -> const surface::HeightView* {
            const station::TwinRun* const twin = station.twin();
            return twin != nullptr ? twin->heights() : nullptr;
          },
          [&keeper] {
            const auto scene = keeper.scene();
            return scene ? scene->checked.ground : surface::HeightGrid{};
          }};
}

}  // namespace telenano::app

#include <CLI/CLI.hpp>
#include <memory>
#include <string>
#include <utility>

#include "telenano/common/base/version.h"
#include "telenano/common/config/program.h"
#include "telenano/common/hash/sha256.h"
#include "telenano/nve_server/app/keys/keys_command.h"
#include "telenano/nve_server/app/sample/fit_command.h"
#include "telenano/nve_server/app/sample/import_command.h"
#include "telenano/nve_server/app/scene/check_command.h"
#include "telenano/nve_server/app/scene/curve_command.h"
#include "telenano/nve_server/app/scene/scene_loading.h"
#include "telenano/nve_server/app/scene/trace_command.h"
#include "telenano/nve_server/app/serve/serve_afm.h"
#include "telenano/nve_server/app/serve/serve_command.h"
#include "telenano/nve_server/app/serve/surface_keeper.h"
#include "telenano/nve_server/scene/scene_bundle.h"
#include "telenano/nve_server/slave/canonical_motion.h"
#include "telenano/nve_server/slave/nve_slave.h"

namespace {

void offer_bundle(telenano::scene::SceneWithBundle both, telenano::server::ServedScene& served) {
  if (!telenano::has_sha256()) both.why_none = "this program was built without OpenSSL";
  served.why_no_fetch = both.why_none;
  if (!both.why_none.empty()) return;
  auto to_fetch = std::make_shared<telenano::server::SceneToFetch>();
  const telenano::Sha256 hash = telenano::sha256(both.bundle);
  for (std::size_t i = 0; i < hash.size(); ++i)
    to_fetch->offer.hash[i / 8] |= std::uint64_t{hash[i]} << (8 * (i % 8));
  to_fetch->offer.bytes = static_cast<std::uint32_t>(both.bundle.size());
  to_fetch->offer.canonical_motion = telenano::slave::canonical_motion_hash(both.scene);
  to_fetch->bytes = std::move(both.bundle);
  served.to_fetch = std::move(to_fetch);
}

/// The unmarked surface over the workspace; what is finer than a 127th of it is not shown.
telenano::surface::HeightGrid heights_of(const telenano::scene::Scene& scene,
                                         const telenano::slave::SlaveLimits& limits) {
  telenano::surface::HeightGrid grid;
  grid.columns = grid.rows = 128;
  grid.x_first_nm = limits.workspace_min_w_nm[0];
  grid.y_first_nm = limits.workspace_min_w_nm[1];
  grid.dx_nm = (limits.workspace_max_w_nm[0] - grid.x_first_nm) / (grid.columns - 1);
  grid.dy_nm = (limits.workspace_max_w_nm[1] - grid.y_first_nm) / (grid.rows - 1);
  for (int j = 0; j < grid.rows; ++j)
    for (int i = 0; i < grid.columns; ++i)
      grid.z_nm.push_back(
          scene.surface->height_nm(grid.x_first_nm + i * grid.dx_nm, grid.y_first_nm + j * grid.dy_nm));
  return grid;
}

telenano::server::ServedScene serve_scene(const std::string& path, const std::string& surface_folder,
                                          std::shared_ptr<const telenano::scene::Scene>& loaded) {
  auto both = telenano::app::load_scene_with_bundle(path);
  const auto scene = both.scene;
  loaded = scene;
  telenano::server::ServedScene served;
  served.name = telenano::server::scene_name(scene->name);
  served.hash = scene->hash;
  served.timeout_ms = scene->session_timeout_ms;
  offer_bundle(std::move(both), served);
  if (surface_folder.empty()) {
    served.make_slave = telenano::slave::nve_slaves(scene);
  } else {
    const auto keeper = std::make_shared<telenano::app::SurfaceKeeper>(scene, surface_folder);
    served.make_slave = [keeper] { return telenano::app::SurfaceKeeper::make_slave(keeper); };
  }
  return served;
}

}  // namespace

// What flags are made of throws for want of memory only. NOLINTNEXTLINE(bugprone-exception-escape)
int main(int argc, char** argv) {
  CLI::App app("Telenano's nanoscale virtual environment: what the tip feels", "telenano-nve");
  app.set_version_flag("--version", std::string("telenano-nve ") + telenano::kVersion);
  app.require_subcommand(1);
  int exit_code = 0;
  std::shared_ptr<const telenano::scene::Scene> loaded;
  telenano::app::add_serve_command(
      app,
      [&](const std::string& path, const std::string& folder) { return serve_scene(path, folder, loaded); },
      exit_code, [&] { return heights_of(*loaded, telenano::slave::nve_slaves(loaded)()->limits()); });
  telenano::app::add_afm_guard_command(app, exit_code);
  telenano::app::add_afm_command(app);
  telenano::app::add_curve_command(app);
  telenano::app::add_check_command(app);
  telenano::app::add_trace_command(app);
  telenano::app::add_import_command(app);
  telenano::app::add_fit_command(app);
  telenano::app::add_keys_command(app);
  return telenano::config::run_program(app, argc, argv, exit_code);
}

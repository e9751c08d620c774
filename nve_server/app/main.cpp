#include <CLI/CLI.hpp>
#include <memory>
#include <string>
#include <utility>

#include "telenano/common/base/version.h"
#include "telenano/common/config/program.h"
#include "telenano/common/hash/sha256.h"
#include "telenano/nve_server/app/check_command.h"
#include "telenano/nve_server/app/curve_command.h"
#include "telenano/nve_server/app/import_command.h"
#include "telenano/nve_server/app/keys_command.h"
#include "telenano/nve_server/app/scene_loading.h"
#include "telenano/nve_server/app/serve_afm.h"
#include "telenano/nve_server/app/serve_command.h"
#include "telenano/nve_server/app/surface_keeper.h"
#include "telenano/nve_server/app/trace_command.h"
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

telenano::server::ServedScene serve_scene(const std::string& path, const std::string& surface_folder) {
  auto both = telenano::app::load_scene_with_bundle(path);
  const auto scene = both.scene;
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
  telenano::app::add_serve_command(app, serve_scene, exit_code);
  telenano::app::add_afm_guard_command(app, exit_code);
  telenano::app::add_afm_command(app);
  telenano::app::add_curve_command(app);
  telenano::app::add_check_command(app);
  telenano::app::add_trace_command(app);
  telenano::app::add_import_command(app);
  telenano::app::add_keys_command(app);
  return telenano::config::run_program(app, argc, argv, exit_code);
}

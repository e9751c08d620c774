#include "telenano/nve_server/app/scene/curve_command.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <optional>

#include "telenano/common/config/completion.h"
#include "telenano/common/config/program.h"
#include "telenano/nve_server/app/scene/scene_loading.h"
#include "telenano/nve_server/scene/force_curve.h"
#include "telenano/nve_server/scene/scene.h"

namespace telenano::app {
namespace {

struct Options {
  std::string scene;
  std::optional<double> x_nm;  // left out: the scene's start
  std::optional<double> y_nm;
  scene::CurvePlan plan;
};

void run(const Options& options) {
  const auto scene = load_scene(options.scene);
  scene::CurvePlan plan = options.plan;
  plan.x_nm = options.x_nm.value_or(scene->start_apex_w_nm.x());
  plan.y_nm = options.y_nm.value_or(scene->start_apex_w_nm.y());
  scene::check_plan(*scene, plan);
  std::puts("direction,base_z_nm,tip_z_nm,overlap_nm,force_nn,deflection_nm,branch,work_aj");
  const auto way = [](bool approach) { return approach ? "approach" : "retract"; };
  const scene::CurveOutcome outcome = scene::run_curve(
      *scene, plan,
      [&](const scene::CurveRow& row) {
        config::require_stdout();
        std::printf("%s,%.15g,%.15g,%.15g,%.15g,%.15g,%s,%.15g\n", way(row.approach), row.base_z_nm,
                    row.tip_z_nm, row.overlap_nm, row.force_nn, row.deflection_nm,
                    scene::branch_name(row.branch), row.work_aj);
      },
      [&](const scene::CurveGap& gap) {
        std::printf("# no balance of tip and cantilever: %s, base_z_nm = %.15g\n", way(gap.approach),
                    gap.base_z_nm);
      });
  std::fflush(stdout);
  config::require_stdout();
  if (outcome.gaps > 0) {
    std::fprintf(stderr,
                 "telenano-nve: curve: %ld of %ld places over (%g, %g) nm have no balance of tip and "
                 "cantilever and no row; the lines with # say which\n",
                 outcome.gaps, outcome.gaps + outcome.rows, plan.x_nm, plan.y_nm);
  }
}

}  // namespace

void add_curve_command(CLI::App& app) {
  CLI::App* command =
      app.add_subcommand("curve", "Compute a force-distance curve of a scene (CSV on standard output)");
  auto options = std::make_shared<Options>();
  command
      ->add_option("--scene", options->scene,
                   "Scene: a file (TOML) or the name of a supplied scene, e.g. flakes")
      ->required()
      ->type_name(config::kSceneOrFile);
  command->add_option("--x-nm", options->x_nm, "Position x, frame W (default: start position of the scene)");
  command->add_option("--y-nm", options->y_nm, "Position y, frame W (default: start position of the scene)");
  command
      ->add_option("--from-nm", options->plan.from_nm,
                   "Highest height of the base above the surface at (x, y)")
      ->capture_default_str();
  command->add_option("--to-nm", options->plan.to_nm, "Lowest height of the base")->capture_default_str();
  command
      ->add_option("--step-nm", options->plan.step_nm,
                   "Distance between rows; jumps between rows are resolved")
      ->capture_default_str();
  command->footer(
      "Columns: direction approach|retract; base_z_nm height of the tip apex with the cantilever "
      "undeflected, above\nthe surface at (x, y), along W z; tip_z_nm = base + deflection; "
      "overlap_nm largest normal overlap, negative = gap;\nforce_nn W-z force on the tip, "
      "repulsive positive; deflection_nm = force/k_z, up positive; branch\n"
      "free|vdw|noncontact|contact; work_aj work done by the base since the first row. The virtual "
      "coupling is not included.\nWhere a scan has no equilibrium of tip and cantilever, a line with # "
      "replaces the row, and the curve continues;\nthe number of such lines is printed on standard error.");
  command->callback([options] { run(*options); });
}

}  // namespace telenano::app

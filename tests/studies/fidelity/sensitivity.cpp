#include "tests/studies/fidelity/sensitivity.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "tests/studies/stress/invariants.h"
#include "tests/studies/stress/stress_run.h"
#include "tests/studies/zwidth/on_all_cores.h"

namespace telenano::studies::fidelity {

std::vector<std::string> broken_rules(const FeltMetrics& m, const Asked& asked) {
  std::vector<std::string> broken;
  if (m.nrmse > asked.nrmse) broken.push_back(fmt::format("NRMSE {:.3g} above {:g}", m.nrmse, asked.nrmse));
  if (std::fabs(m.snap_in_error) > asked.event)
    broken.push_back(fmt::format("snap-in off by {:.0f} %", 100 * m.snap_in_error));
  if (std::fabs(m.pull_off_error) > asked.event)
    broken.push_back(fmt::format("pull-off off by {:.0f} %", 100 * m.pull_off_error));
  if (m.lateral_correlation < asked.correlation)
    broken.push_back(fmt::format("lateral correlation {:.3g}", m.lateral_correlation));
  if (std::fabs(m.lag_ms) > asked.lag_ms) broken.push_back(fmt::format("lag {:g} ms", m.lag_ms));
  if (m.false_releases > 0) broken.push_back(fmt::format("{} false releases", m.false_releases));
  if (std::fabs(m.work_felt_mj - m.work_true_mj) > asked.work * std::max(1.0, std::fabs(m.work_true_mj)))
    broken.push_back(fmt::format("work {:.3g} of {:.3g} mJ", m.work_felt_mj, m.work_true_mj));
  return broken;
}

namespace {

/// Runs of the stress laboratory: its tasks on level ground and on the scan, a press on a wall, hands that
/// want energy; near and far, with loss.
std::vector<stress::RunSpec> stress_runs() {
  std::vector<stress::RunSpec> runs;
  const auto add = [&](stress::SceneKind scene, stress::HandKind hand, double a, double b, double rtt_ms,
                       double loss) {
    stress::RunSpec run;
    run.scene = scene;
    run.hand = hand;
    run.hand_a = a;
    run.hand_b = b;
    run.rtt_ms = rtt_ms;
    run.loss = loss;
    run.seconds = 5;
    runs.push_back(run);
  };
  using stress::HandKind;
  using stress::SceneKind;
  add(SceneKind::kOxide, HandKind::kIndent, 0, 0, 20, 0);
  add(SceneKind::kScan, HandKind::kRaster, 0, 0, 20, 0);
  add(SceneKind::kOxide, HandKind::kPress, 0, 0, 20, 0);
  add(SceneKind::kScan, HandKind::kPress, 0, 0, 20, 0);
  add(SceneKind::kWall, HandKind::kPress, 0, 0, 20, 0);
  add(SceneKind::kOxide, HandKind::kGreedy, 0.1, 0.01, 20, 0.3);
  add(SceneKind::kWall, HandKind::kSquare, 0.008, 0.02, 20, 0);
  return runs;
}

std::uint32_t found_by_stress(WrongRenderer wrong, const stress::RunSpec& run, const stress::Scenes& scenes) {
  stress::RunExtras extras;
  extras.make_method = [wrong] { return wrong_model(wrong, 0); };
  return stress::run(run, scenes, extras).violated & stress::promised(run.method);
}

}  // namespace

std::vector<std::string> telling_motions() {
  return {"flat_silicon_oxide/indent_slow", "flakes/raster", "lithography/plough"};
}

std::vector<SensitivityRow> check_sensitivity(const ScenePairs& scenes) {
  const std::vector<const SceneMotion*> motions = chosen_motions(telling_motions(), false);
  std::array<WrongRenderer, kWrongRenderers.size() + 1> renderers{};  // the right one first
  std::copy(kWrongRenderers.begin(), kWrongRenderers.end(), renderers.begin() + 1);
  std::vector<CellResult> results(renderers.size() * motions.size());
  on_all_cores(results.size(), [&](std::size_t i) {
    Cell cell;
    cell.motion = motions[i % motions.size()];
    cell.method = control::Method::kNone;
    const WrongRenderer wrong = renderers[i / motions.size()];
    results[i] = run_cell(cell, scenes, [&](const control::Scaling& scaling) {
      return local_sample(wrong, scaling, scenes.of(cell.motion->scene).make_served());
    });
  });
  const std::vector<stress::RunSpec> runs = stress_runs();
  const stress::Scenes& stress_scenes = stress::Scenes::of_this_tree();
  std::vector<std::uint32_t> violated(renderers.size() * runs.size());
  on_all_cores(violated.size(), [&](std::size_t i) {
    violated[i] = found_by_stress(renderers[i / runs.size()], runs[i % runs.size()], stress_scenes);
  });
  std::vector<SensitivityRow> rows;
  for (std::size_t r = 0; r < renderers.size(); ++r) {
    SensitivityRow row;
    row.wrong = renderers[r];
    for (std::size_t k = 0; k < runs.size(); ++k) row.stress |= violated[r * runs.size() + k] & ~violated[k];
    for (std::size_t m = 0; m < motions.size(); ++m) {
      const CellResult& result = results[r * motions.size() + m];
      std::vector<std::string> rules = broken_rules(result.metrics);
      const bool worse = rules.size() > row.rules.size() ||
                         (rules.size() == row.rules.size() && result.metrics.nrmse > row.nrmse);
      if (!row.motion.empty() && !worse) continue;
      row.motion = std::string(motions[m]->scene) + "/" + motions[m]->motion;
      row.rules = std::move(rules);
      row.nrmse = result.metrics.nrmse;
    }
    rows.push_back(std::move(row));
  }
  return rows;
}

std::string sensitivity_csv(const std::vector<SensitivityRow>& rows) {
  std::string csv = "renderer,motion,nrmse,stress,broken\n";
  for (const SensitivityRow& row : rows) {
    std::string rules;
    for (const std::string& rule : row.rules) rules += (rules.empty() ? "" : "; ") + rule;
    csv += fmt::format("{},{},{:.4g},{},{}\n", wrong_renderer_name(row.wrong), row.motion, row.nrmse,
                       row.stress == 0 ? "nothing" : stress::invariant_names(row.stress), rules);
  }
  return csv;
}

}  // namespace telenano::studies::fidelity

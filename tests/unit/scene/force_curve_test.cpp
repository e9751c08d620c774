#include "telenano/nve_server/scene/force_curve.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "telenano/common/base/error.h"
#include "tests/source_dir.h"

namespace telenano::scene {
namespace {

std::shared_ptr<const Scene> deployed(const char* name) {
  return load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/" + name + ".toml");
}

std::vector<CurveRow> rows_of(const Scene& scene, const CurvePlan& plan) {
  std::vector<CurveRow> rows;
  run_curve(scene, plan, [&rows](const CurveRow& row) { rows.push_back(row); });
  return rows;
}

TEST(ForceCurve, GoesDownAndUpWithBothEnds) {
  const auto scene = deployed("flat_silicon_oxide");
  const auto rows = rows_of(*scene, {0, 0, 5, -1, 0.25});
  ASSERT_EQ(rows.size(), 50u);
  EXPECT_TRUE(rows[24].approach);
  EXPECT_EQ(rows[24].base_z_nm, -1.0);
  EXPECT_FALSE(rows[25].approach);
  EXPECT_EQ(rows[25].base_z_nm, -1.0);
  EXPECT_EQ(rows.front().base_z_nm, 5.0);
  EXPECT_EQ(rows.back().base_z_nm, 5.0);
  EXPECT_EQ(rows_of(*scene, {0, 0, 1, 0, 0.3}).size(), 10u);  // 1, 0.7, 0.4, 0.1, 0 and back
}

TEST(ForceCurve, ColumnsAgreeWithEachOther) {
  const auto scene = deployed("flat_silicon_oxide");
  for (const CurveRow& row : rows_of(*scene, {0, 0, 20, -5, 0.1})) {
    // Definitions, to rounding; on a flat sample the overlap is minus the tip's height.
    EXPECT_NEAR(row.deflection_nm, row.force_nn / 40.0, 1e-12);
    EXPECT_NEAR(row.tip_z_nm, row.base_z_nm + row.deflection_nm, 1e-12);
    EXPECT_NEAR(row.overlap_nm, -row.tip_z_nm, 1e-8);  // the law's own error, 1e-9 of 100 nN, over k
  }
}

// Work = ∮F dz, which is −∫ of the force column by the trapezium rule plus what a jump does at constant base,
// which is nothing: the base does not move in a jump. The rule's error is O(step²) but O(step·ΔF) where a
// jump falls between two rows: 1e-3 nm × 60 nN a jump.
TEST(ForceCurve, WorkIsTheIntegralOfTheForceAndTheLoopLosesEnergy) {
  for (const char* name : {"flat_silicon_oxide", "flat_polystyrene", "flat_pdms"}) {
    const auto scene = deployed(name);
    const auto rows = rows_of(*scene, {0, 0, 10, -3, 1e-3});
    double work = 0;
    for (std::size_t i = 1; i < rows.size(); ++i) {
      work -= 0.5 * (rows[i].force_nn + rows[i - 1].force_nn) * (rows[i].base_z_nm - rows[i - 1].base_z_nm);
      ASSERT_NEAR(rows[i].work_aj, work, 0.1) << name << " row " << i;
    }
    EXPECT_GT(rows.back().work_aj, 0.0) << name;
  }
}

TEST(ForceCurve, StepSizeDoesNotChangeWhatIsThere) {
  const auto scene = deployed("flat_silicon_oxide");
  const auto fine = rows_of(*scene, {0, 0, 20, -5, 0.01});
  const auto coarse = rows_of(*scene, {0, 0, 20, -5, 1.0});
  for (std::size_t i = 0; i < coarse.size(); ++i) {
    const std::size_t j = i < coarse.size() / 2 ? i * 100 : fine.size() - 1 - (coarse.size() - 1 - i) * 100;
    ASSERT_NEAR(fine[j].base_z_nm, coarse[i].base_z_nm, 1e-9);
    EXPECT_EQ(fine[j].branch, coarse[i].branch) << coarse[i].base_z_nm;
    // Jumps are resolved between rows, so a hundred steps and one end in the same state; 2e-7: both have the
    // law's error, 1e-9 of some 100 nN, and rows that differ by rounding of their base.
    EXPECT_NEAR(fine[j].force_nn, coarse[i].force_nn, 2e-7) << coarse[i].base_z_nm;
    EXPECT_NEAR(fine[j].work_aj, coarse[i].work_aj, 1e-5) << coarse[i].base_z_nm;
  }
}

TEST(ForceCurve, RunsAnywhereOnTheScan) {
  const auto scene = deployed("flakes");
  for (const double x : {60.0, 137.0, 300.0, 511.3}) {
    for (const double y : {88.0, 305.5, 540.0}) {
      double most_attractive = 0, most_repulsive = 0;
      const auto rows = rows_of(*scene, {x, y, 20, -5, 0.05});
      for (const CurveRow& row : rows) {
        ASSERT_TRUE(std::isfinite(row.force_nn) && std::isfinite(row.work_aj));
        most_attractive = std::min(most_attractive, row.force_nn);
        most_repulsive = std::max(most_repulsive, row.force_nn);
      }
      EXPECT_LT(most_attractive, -10.0) << x << " " << y;
      EXPECT_GT(most_repulsive, 50.0) << x << " " << y;
      EXPECT_GT(rows.back().work_aj, 0.0) << x << " " << y;
    }
  }
}

// At this place of the scan, as at one in some hundred, the solver finds no balance on part of the way: the
// curve goes on past it, and each place of the plan has its row or is told to have none.
TEST(ForceCurve, GoesOnPastPlacesWithoutABalance) {
  const auto scene = deployed("flakes");
  std::vector<double> heights;
  long gaps = 0, from_top = 0;
  const CurveOutcome outcome = run_curve(
      *scene, {328.46, 274.75, 10, -6, 0.02},
      [&](const CurveRow& row) {
        ASSERT_TRUE(std::isfinite(row.force_nn) && std::isfinite(row.work_aj));
        heights.push_back(row.base_z_nm);
        from_top += std::abs(row.base_z_nm - 10) < 1e-9;
      },
      [&](const CurveGap& gap) {
        heights.push_back(gap.base_z_nm);
        ++gaps;
      });
  EXPECT_EQ(outcome.gaps, gaps);
  EXPECT_EQ(outcome.rows + outcome.gaps, 2 * 801);
  ASSERT_EQ(heights.size(), 2 * 801u);
  for (std::size_t i = 0; i < heights.size(); ++i) {
    const double step = static_cast<double>(i < 801 ? i : 1601 - i);
    EXPECT_NEAR(heights[i], 10 - 0.02 * step, 1e-9);
  }
  EXPECT_EQ(from_top, 2) << "up and free again at the end";
  EXPECT_LT(outcome.gaps, 200) << "not stuck for ever";
}

TEST(ForceCurve, RefusesImpossiblePlans) {
  const auto scene = deployed("flat_silicon_oxide");
  const auto error_of = [&](const CurvePlan& plan) -> std::string {
    try {
      check_plan(*scene, plan);
    } catch (const UserError& error) {
      return error.what();
    }
    return "no error";
  };
  EXPECT_EQ(error_of({600, 0, 20, -5, 0.01}), "--x-nm is 600, expected [-500, 500]");
  EXPECT_EQ(error_of({0, NAN, 20, -5, 0.01}), "--y-nm is nan, expected [-500, 500]");
  EXPECT_EQ(error_of({0, 0, INFINITY, -5, 0.01}), "--from-nm is inf, expected a height in [-1e5, 1e5]");
  EXPECT_EQ(error_of({0, 0, 5, 20, 0.01}),
            "--to-nm is 20, expected a height in [-1e5, from-nm), since approach goes down");
  EXPECT_EQ(error_of({0, 0, 20, -5, 0}),
            "--step-nm is 0, expected more than 0, at most from-nm - to-nm, and no more than 1e7 rows");
  EXPECT_EQ(error_of({0, 0, 20, -5, 1e-9}),
            "--step-nm is 1e-09, expected more than 0, at most from-nm - to-nm, and no more than 1e7 rows");
}

}  // namespace
}  // namespace telenano::scene

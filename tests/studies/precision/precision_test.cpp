#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "telenano/common/base/error.h"
#include "tests/studies/precision/analytic_surface.h"
#include "tests/studies/precision/law_methods.h"
#include "tests/studies/precision/precision_command.h"
#include "tests/studies/precision/work_precision.h"
#include "tests/support/md_oracle.h"

namespace telenano::studies {
namespace {

/// Of this test alone: tests run side by side.
std::filesystem::path out_of_test() {
  return std::filesystem::temp_directory_path() /
         (std::string("telenano_precision_") +
          ::testing::UnitTest::GetInstance()->current_test_info()->name());
}

std::string slurp(const std::filesystem::path& path) {
  std::ifstream in(path);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

/// Largest error over a short path in contact, relative to |P| + 2.
double worst(const LawMethodEntry& entry, double lambda) {
  const oracle::MaugisDugdale oracle(lambda);
  std::vector<double> overlaps;
  for (int i = 0; i <= 6; ++i) overlaps.push_back(3.0 - 0.4 * i);
  std::vector<double> loads(overlaps.size());
  entry.make(lambda)->run(overlaps, loads.data());
  double most = 0;
  for (std::size_t i = 0; i < overlaps.size(); ++i) {
    const double exact = oracle.at_overlap(overlaps[i]).load;
    const double error = std::fabs(loads[i] - exact) / (std::fabs(exact) + 2);
    most = std::isfinite(error) ? std::max(most, error) : HUGE_VAL;
  }
  return most;
}

const LawMethodEntry& entry(const std::vector<LawMethodEntry>& all, const std::string& family,
                            const std::string& setting) {
  for (const LawMethodEntry& one : all) {
    if (one.family == family && (setting.empty() || one.setting == setting)) return one;
  }
  throw std::out_of_range(family + ", " + setting);
}

// What is compared must be the method, not a mistake in writing it down: each reaches what it can.
TEST(LawMethods, EachReachesItsAccuracy) {
  const auto all = law_methods();
  for (const double lambda : {0.2, 0.73676, 408.71}) {
    EXPECT_LT(worst(entry(all, "MD direct, the loop's call", ""), lambda), 1e-14) << lambda;
    EXPECT_LT(worst(entry(all, "MD table, the loop's call", ""), lambda), 1e-8) << lambda;  // as it claims
    EXPECT_LT(worst(entry(all, "Newton on u, n steps, warm", "n = 4"), lambda), 1e-13) << lambda;
    EXPECT_LT(worst(entry(all, "plain Newton on theta, warm", "n = 5"), lambda), 1e-13) << lambda;
    EXPECT_LT(worst(entry(all, "nested bisection", "50 x 50"), lambda), 1e-11) << lambda;
    EXPECT_LT(worst(entry(all, "Chebyshev in sqrt(Delta)", "n = 64"), lambda), 1e-12) << lambda;
    // Its slopes are those of the product's curve, good to 1e-8 of a cell's rise.
    EXPECT_LT(worst(entry(all, "Hermite table in sqrt(Delta)", "N = 2048"), lambda), 1e-10) << lambda;
  }
  // Iterations cut short err more.
  EXPECT_GT(worst(entry(all, "Newton on u, n steps, warm", "n = 1"), 4.0), 1e-6);
  // m − 1 has lost its digits at large lambda: 1e-16/(m − 1).
  EXPECT_LT(worst(entry(all, "plain Newton on m, warm", "n = 20"), 4.0), 1e-12);
  EXPECT_GT(worst(entry(all, "plain Newton on m, warm", "n = 20"), 1e4), 1e-9);
}

// JKR is the limit of large lambda, DMT that of small: there the annulus takes the load that is left over,
// proportional to A sqrt(lambda), so that a tenth of lambda leaves 1/sqrt(10) of the error.
TEST(LawMethods, ClosedFormsAreTheLimits) {
  const auto all = law_methods();
  EXPECT_LT(worst(entry(all, "closed forms (model error)", "JKR"), 1e4), 1e-8);
  const double at_1e_3 = worst(entry(all, "closed forms (model error)", "DMT"), 1e-3);
  EXPECT_LT(at_1e_3, 5e-2);
  EXPECT_NEAR(worst(entry(all, "closed forms (model error)", "DMT"), 1e-5) / at_1e_3, 0.1, 0.02);
  EXPECT_GT(worst(entry(all, "closed forms (model error)", "DMT"), 10), 0.1);
}

// The product's laws through the loop's call: JKR at its limit, DMT as the textbook formula, the fits within
// the errors at lambda = 0.5 that closed_form_laws.h states for Delta = -0.5 ... 10, and not exact.
TEST(LawMethods, ProductsLawsErrAsTheyState) {
  const auto all = law_methods();
  const std::string family = "other laws, the loop's call";
  EXPECT_LT(worst(entry(all, family, "JKR"), 1e4), 1e-8);
  EXPECT_GT(worst(entry(all, family, "Hertz"), 0.5), 0.2);
  for (const double lambda : {0.1, 10.0}) {
    EXPECT_NEAR(worst(entry(all, family, "DMT"), lambda),
                worst(entry(all, "closed forms (model error)", "DMT"), lambda), 1e-12);
  }
  const std::pair<const char*, double> stated[] = {
      {"COS", 0.098}, {"Piétrement–Troyon", 0.021}, {"Schwarz", 0.23}, {"JKR", 0.129}};
  for (const auto& [name, most] : stated) {
    EXPECT_LT(worst(entry(all, family, name), 0.5), most) << name;
    EXPECT_GT(worst(entry(all, family, name), 0.5), 1e-3) << name;
  }
}

// dP/dDelta against the oracle's, and P.
TEST(InContact, ForceAndStiffness) {
  for (const double lambda : {0.5, 4.0, 400.0}) {
    const oracle::MaugisDugdale oracle(lambda);
    InContact law(lambda);
    for (const double overlap : {10.0, 5.0, 2.0, 1.0}) {
      const auto exact = oracle.at_overlap(overlap);
      const InContact::State state = law.at(overlap);
      EXPECT_NEAR(state.load, exact.load, 1e-12 * (2 + std::fabs(exact.load)));
      EXPECT_NEAR(state.slope, exact.slope, 1e-10 * exact.slope);
    }
  }
}

// The jet against differences of the height: 1e-4 nm steps leave 1e-9 (slope) and 1e-7 (curvature).
TEST(AnalyticSurface, JetIsTheDerivative) {
  const AnalyticSurface s{3, 25};
  const double h = 1e-4;
  for (const double x : {-7.0, 1.0, 11.0}) {
    const double y = 0.3 * x + 2;
    const auto j = s.jet(x, y);
    EXPECT_NEAR(j.z, s.height_nm(x, y), 1e-14);
    EXPECT_NEAR(j.zx, (s.height_nm(x + h, y) - s.height_nm(x - h, y)) / (2 * h), 1e-9);
    EXPECT_NEAR(j.zy, (s.height_nm(x, y + h) - s.height_nm(x, y - h)) / (2 * h), 1e-9);
    EXPECT_NEAR(j.zxx, (s.jet(x + h, y).zx - s.jet(x - h, y).zx) / (2 * h), 1e-8);
    EXPECT_NEAR(j.zxy, (s.jet(x, y + h).zx - s.jet(x, y - h).zx) / (2 * h), 1e-8);
    EXPECT_NEAR(j.zyy, (s.jet(x, y + h).zy - s.jet(x, y - h).zy) / (2 * h), 1e-8);
  }
}

TEST(Errors, FailuresAreCountedAndNotAveraged) {
  const Errors e = summarise({3, NAN, 1, 2, HUGE_VAL});
  EXPECT_EQ(e.failures, 2);
  EXPECT_EQ(e.points, 5);
  EXPECT_EQ(e.largest, 3);
  EXPECT_EQ(e.median, 2);
  EXPECT_EQ(summarise({NAN}).largest, HUGE_VAL);
}

TEST(Precision, WritesPageFiguresAndRows) {
  const std::filesystem::path out = out_of_test();
  std::filesystem::remove_all(out);
  run_precision({out, true, {"interpolation", "wire"}});
  const std::string page = slurp(out / "index.html");
  EXPECT_NE(page.find("(default)"), std::string::npos);
  EXPECT_NE(page.find("commit "), std::string::npos);
  EXPECT_EQ(page.find("src="), std::string::npos);  // self-contained
  EXPECT_NE(slurp(out / "data" / "wire_rows.csv").find("double"), std::string::npos);
  EXPECT_TRUE(std::filesystem::exists(out / "data" / "interpolation.gp"));
  // The figure's own data, not the rows, beside its script: it can be drawn again by hand.
  EXPECT_EQ(slurp(out / "data" / "interpolation.csv").rfind("# x,y", 0), 0u);
  std::filesystem::remove_all(out);
}

TEST(Precision, SaysWhatIsWrongBeforeMeasuring) {
  const std::filesystem::path out = out_of_test();
  try {
    run_precision({out, true, {"laws"}});
    FAIL();
  } catch (const UserError& error) {
    EXPECT_NE(
        std::string(error.what()).find("--only: 'laws' is unknown; expected some of law, ground, inter"),
        std::string::npos);
  }
  // A file where the folder should be: nobody, not even root, can write into it.
  std::filesystem::remove_all(out);
  std::ofstream(out) << "x";
  EXPECT_THROW(run_precision({out, true, {"wire"}}), UserError);
  std::filesystem::remove(out);
}

}  // namespace
}  // namespace telenano::studies

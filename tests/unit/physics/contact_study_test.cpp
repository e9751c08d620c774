#include "tests/studies/contact_study.h"
#include "tests/studies/parse_list.h"

#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <limits>
#include <sstream>
#include <string>
#include <vector>

#include "telenano/common/base/error.h"
#include "tests/studies/contact_command.h"
#include "tests/support/md_oracle.h"

namespace telenano::studies {
namespace {

std::string output_of(const ContactOptions& options) {
  std::FILE* file = std::tmpfile();
  run_contact(options, file);
  std::string text(static_cast<std::size_t>(std::ftell(file)), '\0');
  std::rewind(file);
  EXPECT_EQ(std::fread(text.data(), 1, text.size(), file), text.size());
  std::fclose(file);
  return text;
}

std::vector<std::vector<std::string>> rows(const ContactOptions& options) {
  std::istringstream in(output_of(options));
  std::vector<std::vector<std::string>> all;
  for (std::string line; std::getline(in, line);) {
    std::vector<std::string> cells;
    std::istringstream cut(line);
    for (std::string cell; std::getline(cut, cell, ',');) cells.push_back(cell);
    all.push_back(cells);
  }
  return all;
}

TEST(ContactStudy, PrintsTheCurveWithMemory) {
  ContactOptions o;
  o.lambda = {1};
  // H0 = 0.6366; fold -0.9917: out past the fold, back to between both, in, and between both again.
  o.delta = {-0.8, 0, -0.8, -1.0, -0.8, -0.6};
  const auto r = rows(o);
  ASSERT_EQ(r.size(), 7u);
  EXPECT_EQ(r[0], (std::vector<std::string>{"lambda", "delta", "force", "contact_radius", "branch"}));
  EXPECT_EQ(r[1], (std::vector<std::string>{"1", "-0.8", "0", "0", "free"}));
  EXPECT_EQ(r[2][4], "contact");
  EXPECT_NEAR(std::stod(r[2][2]), -1.405467, 1e-6);
  EXPECT_EQ(r[3][4], "contact");
  EXPECT_EQ(r[4][4], "free");
  EXPECT_EQ(r[5][4], "free");
  EXPECT_EQ(r[6][4], "contact");
  const oracle::MaugisDugdale oracle(1);
  for (const int i : {2, 3, 6}) {
    const auto want = oracle.at_overlap(std::stod(r[static_cast<std::size_t>(i)][1]));
    // Fifteen printed digits.
    EXPECT_NEAR(std::stod(r[static_cast<std::size_t>(i)][2]), want.load, 2e-14);
    EXPECT_NEAR(std::stod(r[static_cast<std::size_t>(i)][3]), want.contact_radius, 2e-13);
  }
}

TEST(ContactStudy, LambdaIsTheOuterLoopAndStartsAfresh) {
  ContactOptions o;
  o.lambda = {0.5, 2};
  o.delta = {-0.9, 1, -0.9};
  const auto r = rows(o);
  ASSERT_EQ(r.size(), 7u);
  EXPECT_EQ(r[3][0], "0.5");
  EXPECT_EQ(r[4][0], "2");
  EXPECT_EQ(r[4][4], "free");
  EXPECT_EQ(r[6][4], "contact");
}

TEST(ContactStudy, ExactlyAtTheRange) {
  for (const double lambda : {0.1, 0.3, 0.6}) {
    ContactOptions o;
    o.lambda = {lambda};
    for (const double range : {2 / (M_PI * lambda), 2 / M_PI / lambda, 0.63661977236758134308 / lambda}) {
      o.delta = {-range};
      o.retract = false;
      EXPECT_EQ(rows(o)[1][4], "free") << lambda;
      o.retract = true;
      EXPECT_EQ(rows(o)[1][4], "noncontact") << lambda;
      EXPECT_EQ(rows(o)[1][3], "0");
    }
  }
}

TEST(ContactStudy, Points) {
  ContactOptions o;
  o.points = true;
  o.lambda = {0.1, 1, 408.71};
  const auto r = rows(o);
  ASSERT_EQ(r.size(), 4u);
  EXPECT_EQ(r[0], (std::vector<std::string>{"lambda", "pull_off_load", "delta_fold", "radius_zero_load",
                                            "delta_zero_load", "loop_energy"}));
  for (std::size_t i = 0; i < 3; ++i) {
    const oracle::MaugisDugdale oracle(o.lambda[i]);
    EXPECT_NEAR(std::stod(r[i + 1][1]), oracle.pull_off_load(), 1e-14);
    EXPECT_NEAR(std::stod(r[i + 1][2]), oracle.fold_overlap(), 2e-14);
    EXPECT_NEAR(std::stod(r[i + 1][3]), oracle.zero_load_radius(), 1e-14);
    EXPECT_NEAR(std::stod(r[i + 1][4]), oracle.zero_load_overlap(), 1e-14);
    EXPECT_NEAR(std::stod(r[i + 1][5]), oracle.loop_energy(), 1e-13);
  }
}

TEST(ContactStudy, BadValuesAreNamedInOneLine) {
  const auto message = [](const ContactOptions& o) -> std::string {
    try {
      run_contact(o, stderr);
    } catch (const UserError& e) {
      return e.what();
    }
    return "";
  };
  ContactOptions good;
  good.lambda = {1};
  good.delta = {0};
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  for (const double bad : {0.0, -1.0, kNan, std::numeric_limits<double>::infinity()}) {
    ContactOptions o = good;
    o.lambda = {1, bad};
    EXPECT_NE(message(o).find("--lambda"), std::string::npos) << bad;
    EXPECT_EQ(message(o).find('\n'), std::string::npos);
  }
  ContactOptions o = good;
  o.delta = {kNan};
  EXPECT_NE(message(o).find("--delta"), std::string::npos);
  o = good;
  o.delta = {};
  EXPECT_NE(message(o).find("--delta"), std::string::npos);
  o = good;
  o.lambda = {};
  EXPECT_NE(message(o).find("--lambda"), std::string::npos);
  o = good;
  o.law = "hertz";
  EXPECT_NE(message(o).find("md"), std::string::npos);
}

TEST(ContactStudy, Lists) {
  EXPECT_EQ(parse_list("0,0.5,-1e3", "--delta"), (std::vector<double>{0, 0.5, -1000}));
  EXPECT_EQ(parse_list(" 1 , +2", "--delta"), (std::vector<double>{1, 2}));
  for (const char* bad : {"", "1,", ",1", "1;2", "x", "1 2", "--1"}) {
    EXPECT_THROW(parse_list(bad, "--delta"), UserError) << bad;
  }
}

TEST(ContactStudy, CommandLine) {
  const auto parse = [](const std::string& line) {
    CLI::App app("lab");
    add_contact_command(app);
    app.parse(line);
  };
  ::testing::internal::CaptureStdout();
  EXPECT_NO_THROW(parse("contact --law md --lambda 1 --delta -0.5,0 --direction retract"));
  EXPECT_NE(::testing::internal::GetCapturedStdout().find("1,-0.5,"), std::string::npos);
  EXPECT_THROW(parse("contact --law md --lambda 0 --delta 0"), UserError);
  EXPECT_THROW(parse("contact --law md --lambda 1 --delta 0 --direction sideways"), UserError);
  EXPECT_THROW(parse("contact --law md --lambda \"\" --delta 0"), std::exception);
  EXPECT_THROW(parse("contact --delta 0"), UserError);
}

}  // namespace
}  // namespace telenano::studies

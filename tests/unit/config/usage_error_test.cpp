#include "telenano/common/config/usage_error.h"

#include <gtest/gtest.h>

namespace telenano::config {
namespace {

std::string said(const std::vector<std::string>& arguments,
                 const std::string& what = "what the parser says") {
  return usage_error("prog", what, arguments, {"serve", "curve", "check"},
                     {"--help", "--scene", "--step-nm"});
}

TEST(UsageError, NamesAnUnknownCommand) {
  EXPECT_EQ(
      said({"cerve"}),
      "prog: unknown command 'cerve', expected serve, curve or check; did you mean serve? (see prog --help)");
  EXPECT_EQ(said({"12"}), "prog: unknown command '12', expected serve, curve or check (see prog --help)");
  EXPECT_EQ(said({}), "prog: a command is missing, expected serve, curve or check (see prog --help)");
}

TEST(UsageError, NamesAnUnknownFlagWithItsNearest) {
  EXPECT_EQ(said({"curve", "--scene", "a.toml", "--step", "1"}).find("prog: unknown flag --step"), 0u);
  EXPECT_EQ(said({"curve", "--scen=a.toml"}),
            "prog: unknown flag --scen; did you mean --scene? (see prog --help)");
  EXPECT_EQ(said({"--quick"}), "prog: unknown flag --quick (see prog --help)");
}

TEST(UsageError, LeavesTheRestToTheParserInOneLine) {
  EXPECT_EQ(said({"curve", "--step-nm", "-1"}), "prog: what the parser says (see prog --help)");
  EXPECT_EQ(said({"curve", "a\nb"}, "not expected: a\nb"), "prog: not expected: a b (see prog --help)");
}

}  // namespace
}  // namespace telenano::config

#include "telenano/common/config/toml_document.h"

#include <gtest/gtest.h>

#include <functional>

#include "telenano/common/base/error.h"
#include "telenano/common/config/edit_distance.h"

namespace telenano::config {
namespace {

std::string error_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const UserError& error) {
    return error.what();
  }
  return "no error";
}

TEST(TomlDocument, ReadsEveryKind) {
  const TomlDocument document = TomlDocument::parse(
      "name = 'a'\n[sample]\nmodulus_gpa = 70\nratio = 0.27\nflat = true\ncount = 3\nkind = 'scan'\n"
      "list = [1, 2.5]\n[[task]]\nid = 1\n[[task]]\nid = 2\n",
      "f.toml");
  const TomlTable root = document.root();
  EXPECT_EQ(root.text("name"), "a");
  const TomlTable sample = root.table("sample");
  EXPECT_EQ(sample.number("modulus_gpa", positive()), 70.0);  // an integer is a number
  EXPECT_EQ(sample.number("ratio", {-1.0, 0.5, true, false}), 0.27);
  EXPECT_TRUE(sample.boolean("flat"));
  EXPECT_EQ(sample.integer("count", 1, 5), 3);
  EXPECT_EQ(sample.choice("kind", {"flat", "scan"}), "scan");
  EXPECT_EQ(sample.numbers("list", Range{}, 1, 3), (std::vector<double>{1.0, 2.5}));
  EXPECT_EQ(sample.number_or("absent", positive(), 4.0), 4.0);
  EXPECT_EQ(sample.text_or("absent", "x"), "x");
  EXPECT_FALSE(sample.optional_number("absent", positive()).has_value());
  const auto tasks = root.tables("task");
  ASSERT_EQ(tasks.size(), 2u);
  EXPECT_EQ(tasks[0].integer("id", 0, 9), 1);
  EXPECT_EQ(tasks[1].integer("id", 0, 9), 2);
  EXPECT_NO_THROW(document.finish());
}

struct BadCase {
  const char* content;
  std::function<void(const TomlTable&)> read;
  const char* line;
};

TEST(TomlDocument, EveryMistakeIsOneLineNamingFileLineKeyAndRange) {
  const auto modulus = [](const TomlTable& t) {
    t.table("sample").number("youngs_modulus_gpa", positive(2000));
  };
  const BadCase cases[] = {
      {"[sample]\nyoungs_modulus_gpa = -1\n", modulus,
       "f.toml:2: 'youngs_modulus_gpa' in [sample] is -1, expected a number in (0, 2000]"},
      {"[sample]\nyoungs_modulus_gpa = nan\n", modulus,
       "f.toml:2: 'youngs_modulus_gpa' in [sample] is nan, expected a number in (0, 2000]"},
      {"[sample]\nyoungs_modulus_gpa = inf\n", modulus,
       "f.toml:2: 'youngs_modulus_gpa' in [sample] is inf, expected a number in (0, 2000]"},
      {"[sample]\nyoungs_modulus_gpa = '70'\n", modulus,
       "f.toml:2: 'youngs_modulus_gpa' in [sample] is a text, expected a number in (0, 2000]"},
      {"[sample]\nyoungs_modulus_pa = 7e10\n", modulus,
       "f.toml:2: unknown key 'youngs_modulus_pa' in [sample]; did you mean 'youngs_modulus_gpa'?"},
      {"[sample]\n", modulus,
       "f.toml:1: missing key 'youngs_modulus_gpa' in [sample] (expected a number in (0, 2000])"},
      {"x = 1\n", modulus, "f.toml:1: missing key 'sample' at the top level (expected a table [sample])"},
      {"sample = 1\n", modulus,
       "f.toml:1: 'sample' at the top level is an integer, expected a table [sample]"},
      {"n = 2.5\n", [](const TomlTable& t) { t.integer("n", 0, 9); },
       "f.toml:1: 'n' at the top level is a decimal number, expected an integer in [0, 9]"},
      {"n = 10\n", [](const TomlTable& t) { t.integer("n", 0, 9); },
       "f.toml:1: 'n' at the top level is 10, expected an integer in [0, 9]"},
      {"b = 1\n", [](const TomlTable& t) { t.boolean("b"); },
       "f.toml:1: 'b' at the top level is an integer, expected true or false"},
      {"k = 'flut'\n",
       [](const TomlTable& t) {
         t.choice("k", {"flat", "scan"});
       },
       "f.toml:1: 'k' at the top level is 'flut', expected one of 'flat', 'scan'"},
      {"l = [1, nan]\n", [](const TomlTable& t) { t.numbers("l", Range{}, 2, 2); },
       "f.toml:1: 'l[1]' at the top level is nan, expected a finite number"},
      {"l = [1]\n", [](const TomlTable& t) { t.numbers("l", Range{}, 2, 2); },
       "f.toml:1: 'l' at the top level is an array of 1, expected an array of 2 numbers, each a finite "
       "number"},
      {"[t]\n", [](const TomlTable& t) { t.tables("t"); },
       "f.toml:1: 't' at the top level is a table, expected tables [[t]]"},
  };
  for (const BadCase& bad : cases) {
    const TomlDocument document = TomlDocument::parse(bad.content, "f.toml");
    EXPECT_EQ(error_of([&] { bad.read(document.root()); }), bad.line) << bad.content;
  }
}

TEST(TomlDocument, ReportsWhatNobodyAskedFor) {
  const TomlDocument document =
      TomlDocument::parse("a = 1\n[t]\nb = 1\n[t.u]\nc = 1\nstiffnes_n_m = 2\n", "f.toml");
  EXPECT_EQ(error_of([&] { document.finish(); }), "f.toml:1: unknown key 'a' at the top level");
  document.root().has("a");
  EXPECT_EQ(error_of([&] { document.finish(); }), "f.toml:2: unknown table 't' at the top level");
  const TomlTable t = document.root().table("t");
  EXPECT_EQ(error_of([&] { document.finish(); }), "f.toml:3: unknown key 'b' in [t]");
  t.has("b");
  const TomlTable u = t.table("u");
  u.has("c");
  u.number_or("stiffness_n_m", positive(), 1.0);
  EXPECT_EQ(error_of([&] { document.finish(); }),
            "f.toml:6: unknown key 'stiffnes_n_m' in [t.u]; did you mean 'stiffness_n_m'?");
}

TEST(TomlDocument, SyntaxErrorAndMissingFileAreOneLine) {
  const std::string syntax = error_of([] { TomlDocument::parse("a = 1\nb = = 2\n", "f.toml"); });
  EXPECT_EQ(syntax.rfind("f.toml:2: not valid TOML: ", 0), 0u) << syntax;
  EXPECT_EQ(syntax.find('\n'), std::string::npos);
  EXPECT_EQ(error_of([] { TomlDocument::load("/nowhere/f.toml"); }),
            "/nowhere/f.toml: cannot be read: No such file or directory");
  EXPECT_EQ(error_of([] { TomlDocument::load("/"); }), "/: is a folder, expected a TOML file");
}

TEST(TomlDocument, WhatIsQuotedMakesNoSecondLine) {
  const auto error_of = [](const std::string& text, const auto& read) -> std::string {
    try {
      const TomlDocument document = TomlDocument::parse(text, "x.toml");
      read(document.root());
      document.finish();
    } catch (const UserError& error) {
      return error.what();
    }
    return "no error";
  };
  const auto choose = [](const TomlTable& root) { root.choice("a", {"b", "c"}); };
  EXPECT_EQ(error_of("a = \"b\\nc\\u001b[2J\"", choose),
            "x.toml:1: 'a' at the top level is 'b\\x0ac\\x1b[2J', expected one of 'b', 'c'");
  EXPECT_EQ(error_of("a = \"b\"\n\"d\\te\" = 1", choose), "x.toml:2: unknown key 'd\\x09e' at the top level");
  // Not only control characters of ASCII are bytes below it: words of any language stay.
  EXPECT_EQ(error_of("a = \"ä\"", choose), "x.toml:1: 'a' at the top level is 'ä', expected one of 'b', 'c'");
}

TEST(TomlDocument, ResolvesPathsAgainstItsFolder) {
  const TomlDocument document = TomlDocument::parse("", "deploy/scenes/f.toml");
  EXPECT_EQ(document.resolve("../data/x.gsf"), "deploy/data/x.gsf");
  EXPECT_EQ(document.resolve("/abs/x.gsf"), "/abs/x.gsf");
}

TEST(EditDistance, CountsChanges) {
  EXPECT_EQ(edit_distance("", "abc"), 3u);
  EXPECT_EQ(edit_distance("kitten", "sitting"), 3u);
  EXPECT_EQ(edit_distance("ab", "ba"), 1u);  // neighbours swapped
  EXPECT_EQ(nearest_name("tip_radius_um", {"tip_radius_nm", "youngs_modulus_gpa"}), "tip_radius_nm");
  EXPECT_EQ(nearest_name("colour", {"tip_radius_nm", "youngs_modulus_gpa"}), "");
}

}  // namespace
}  // namespace telenano::config

#include "telenano/common/config/completion.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>

namespace telenano::config {
namespace {

/// What bash itself makes of the script, for a line typed so far; "|" between the words offered.
std::string offered(const CLI::App& app, const std::string& line) {
  const auto file =
      std::filesystem::temp_directory_path() / ("telenano_completion_" + std::to_string(::getpid()));
  std::ofstream(file)
      << bash_completion(app) << "COMP_WORDS=(" << line << ")\n"
      << (line.ends_with(' ') ? "COMP_WORDS+=('')\n" : "")
      << "COMP_CWORD=$((${#COMP_WORDS[@]} - 1))\ncd /\n_telenano_thing\nIFS='|'; echo \"${COMPREPLY[*]}\"\n";
  std::string text;
  if (FILE* pipe = ::popen(("bash " + file.string()).c_str(), "r")) {
    char part[4096];
    while (std::fgets(part, sizeof part, pipe) != nullptr) text += part;
    ::pclose(pipe);
  }
  std::filesystem::remove(file);
  while (text.ends_with('\n')) text.pop_back();
  return text;
}

class Completion : public testing::Test {
 protected:
  Completion() : app_("a thing", "telenano-thing") {
    app_.require_subcommand(1);
    CLI::App* run = app_.add_subcommand("run", "runs");
    run->add_option("--method", method_, "how")->check(CLI::IsMember({"none", "ks", "ks-clamp"}));
    run->add_option("--record", file_, "where");
    run->add_option("--device", device_, "which")->type_name("{sim,omega,replay:FILE}");
    run->add_option("--scene", scene_, "what")->type_name(kSceneOrFile);
    run->add_flag("--quiet", quiet_, "says nothing");
    app_.add_subcommand("keys", "keys")->add_subcommand("revoke", "takes one away");
  }
  CLI::App app_;
  std::string method_, file_, device_, scene_;
  bool quiet_ = false;
};

TEST_F(Completion, Commands) {
  EXPECT_EQ(offered(app_, "telenano-thing r"), "run");
  EXPECT_EQ(offered(app_, "telenano-thing keys re"), "revoke");
}

TEST_F(Completion, FlagsOfTheCommandAtHand) {
  EXPECT_EQ(offered(app_, "telenano-thing run --m"), "--method");
  EXPECT_EQ(offered(app_, "telenano-thing run --quiet --rec"), "--record");
  EXPECT_EQ(offered(app_, "telenano-thing keys --m"), "");
}

TEST_F(Completion, ChoicesAndFiles) {
  EXPECT_EQ(offered(app_, "telenano-thing run --method "), "none|ks|ks-clamp");
  EXPECT_EQ(offered(app_, "telenano-thing run --method ks-"), "ks-clamp");
  EXPECT_EQ(offered(app_, "telenano-thing run --record et"), "etc");
}

TEST_F(Completion, WordsOfAnOptionThatChecksThemItself) {
  EXPECT_EQ(offered(app_, "telenano-thing run --device "), "sim|omega|replay:");
  EXPECT_EQ(offered(app_, "telenano-thing run --device o"), "omega");
}

// The names that find_shared knows, and files: nothing in / begins so.
TEST_F(Completion, ScenesByNameAndByFile) {
  const auto share =
      std::filesystem::temp_directory_path() / ("telenano_completion_share_" + std::to_string(::getpid()));
  std::filesystem::create_directories(share / "scenes");
  for (const char* name : {"flat_gold.toml", "flakes.toml", "README.md"})
    std::ofstream(share / "scenes" / name);
  ::setenv("TELENANO_SHARE", share.c_str(), 1);
  EXPECT_EQ(offered(app_, "telenano-thing run --scene fl"), "flakes|flat_gold");
  EXPECT_EQ(offered(app_, "telenano-thing run --scene et"), "etc");
  ::unsetenv("TELENANO_SHARE");
  std::filesystem::remove_all(share);
}

}  // namespace
}  // namespace telenano::config

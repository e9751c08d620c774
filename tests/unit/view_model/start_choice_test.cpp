#include "telenano/master/view_model/start_choice.h"

#include <gtest/gtest.h>

#include <cstdio>

namespace telenano::view_model {
namespace {

using Words = std::vector<std::string>;

TEST(StartChoice, ArgumentsAreThoseThatAPersonWouldType) {
  StartChoice choice;
  EXPECT_EQ(run_arguments(choice), (Words{"run", "--server", "127.0.0.1:5100", "--device", "sim", "--view"}));
  choice.server = "[::1]:5100";
  choice.device = "mouse";
  choice.key = "lab one.key";
  choice.method = "tank";
  choice.record = choice.guide = true;
  choice.recording = "a.h5";
  EXPECT_EQ(run_arguments(choice),
            (Words{"run", "--server", "[::1]:5100", "--device", "mouse", "--view", "--key", "lab one.key",
                   "--method", "tank", "--guide", "--record", "a.h5"}));
  EXPECT_EQ(plan_arguments(choice),
            (Words{"plan", "--server", "[::1]:5100", "--felt", "--method", "tank", "--key", "lab one.key"}));
}

TEST(StartChoice, AKeyPairOfItsOwnGoesIntoTheSessionAndIntoItsPlan) {
  StartChoice choice;
  choice.identity = "omega 1.id";
  choice.server_key = "sha256:ab";
  EXPECT_EQ(run_arguments(choice), (Words{"run", "--server", "127.0.0.1:5100", "--device", "sim", "--view",
                                          "--identity", "omega 1.id", "--server-key", "sha256:ab"}));
  EXPECT_EQ(plan_arguments(choice), (Words{"plan", "--server", "127.0.0.1:5100", "--felt", "--method", "auto",
                                           "--identity", "omega 1.id", "--server-key", "sha256:ab"}));
}

TEST(StartChoice, ASceneOfTheServerGoesIntoTheSessionAndIntoItsPlan) {
  StartChoice choice;
  choice.server_scene = "flat PDMS";
  EXPECT_EQ(run_arguments(choice), (Words{"run", "--server", "127.0.0.1:5100", "--device", "sim", "--view",
                                          "--server-scene", "flat PDMS"}));
  EXPECT_EQ(plan_arguments(choice), (Words{"plan", "--server", "127.0.0.1:5100", "--felt", "--method", "auto",
                                           "--server-scene", "flat PDMS"}));
}

// What is shown is what a shell makes the same words of: asked of the shell itself.
TEST(StartChoice, AShellReadsTheLineAsTheseWords) {
  const Words words{"run", "[::1]:5100", "a b", "it's", "$HOME", "*", "", "a\"b\\c", "m\u00fc;rm"};
  Words printed{"%s|"};
  printed.insert(printed.end(), words.begin(), words.end());
  const std::string line = shell_line("printf", printed);
  std::FILE* const shell = ::popen(line.c_str(), "r");
  ASSERT_NE(shell, nullptr);
  std::string read;
  for (int c = 0; (c = std::fgetc(shell)) != EOF;) read += static_cast<char>(c);
  ::pclose(shell);
  std::string expected;
  for (const std::string& word : words) expected += word + "|";
  EXPECT_EQ(read, expected) << line;
  EXPECT_EQ(shell_line("telenano-master", {"run", "--server", "host:5100"}),
            "telenano-master run --server host:5100");
}

// Read by the parser as a value, where it would be a flag of its own.
TEST(StartChoice, AFileWhoseNameBeginsWithAHyphenIsNoFlag) {
  StartChoice choice;
  choice.key = "-lab.key";
  choice.record = true;
  choice.recording = "--view";
  EXPECT_EQ(run_arguments(choice), (Words{"run", "--server", "127.0.0.1:5100", "--device", "sim", "--view",
                                          "--key=-lab.key", "--record=--view"}));
}

}  // namespace
}  // namespace telenano::view_model

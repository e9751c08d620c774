// A session while hostile datagrams come as fast as this machine makes them: nothing is accepted, the session
// lives. How much it loses is the machine's business too; bounds here are loose, telenano-lab flood measures.
#include <cstdlib>
#include <map>
#include <sstream>

#include "tests/system/programs.h"

namespace telenano::programs {
namespace {

using Row = std::map<std::string, double>;

std::map<std::string, Row> rows_of(const std::string& csv) {
  std::map<std::string, Row> rows;
  const auto lines = lines_of(csv);
  const auto split = [](const std::string& line) {
    std::vector<std::string> words;
    std::istringstream stream(line);
    for (std::string word; std::getline(stream, word, ',');) words.push_back(word);
    return words;
  };
  for (std::size_t i = 1; i < lines.size(); ++i) {
    const auto names = split(lines[0]);
    const auto words = split(lines[i]);
    for (std::size_t k = 1; k < names.size() && k < words.size(); ++k)
      rows[words[0]][names[k]] = std::strtod(words[k].c_str(), nullptr);
  }
  return rows;
}

class FloodTest : public ProgramsTest {};

TEST_F(FloodTest, NothingIsAcceptedAndTheSessionLives) {
  Server server(scene_path("flat_pdms"));
  ASSERT_TRUE(server.child().wait_for_err("receive buffer ", kLong)) << "the server says what it was granted";
  const Finished flood =
      run_program({kLab, "flood", "--server", server.address(), "--seconds", "2", "--echo"}, {}, kLong);
  ASSERT_EQ(flood.exit_code, 0) << flood.err;
  std::printf("%s", flood.out.c_str());
  auto rows = rows_of(flood.out);
  ASSERT_EQ(rows.size(), 4u) << flood.out;
  Row& flooded = rows["session_flooded"];
  EXPECT_GT(flooded["flood_per_s"], 10'000) << "a flood worth the name";
  EXPECT_EQ(flooded["sessions"], 1) << "never lost, so never taken up again";
  // A server as good as an echo, or better; a machine that is busy with other things loses with both.
  EXPECT_LE(flooded["lost_percent"], 5 + 2 * rows["echo_flooded"]["lost_percent"]);

  const std::string said = server.stop();
  std::printf("%s", said.c_str());
  const double asked = rows["session_alone"]["asked"] + flooded["asked"];
  const auto at = said.find("stopped: ");
  ASSERT_NE(at, std::string::npos) << said;
  EXPECT_LE(std::strtod(said.c_str() + at + 9, nullptr), asked)
      << "only the stations' own commands were answered";
  EXPECT_NE(said.find(" in 2 sessions (0 resumed)"), std::string::npos) << said;
  for (const char* cause : {"bad_magic", "truncated", "unknown_session", "unauthenticated"})
    EXPECT_NE(said.find(cause, at), std::string::npos) << cause << "\n" << said;
}

TEST_F(FloodTest, FloodsThisMachineOnly) {
  const Finished run = run_program({kLab, "flood", "--server", "192.0.2.1:5100"}, {}, kLong);
  EXPECT_EQ(run.exit_code, 2);
  EXPECT_NE(run.err.find("this machine only"), std::string::npos) << run.err;
}

}  // namespace
}  // namespace telenano::programs

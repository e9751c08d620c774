// The ports of an AFM's controller, as --ports names them, and as the documents write them.
#include "telenano/nve_server/app/serve/port_list.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <regex>
#include <string>
#include <vector>

#include "telenano/common/base/error.h"

namespace telenano::app {
namespace {

using Ports = std::vector<std::uint16_t>;

TEST(PortList, RangesAndSinglePortsInAnyOrder) {
  const struct {
    const char* text;
    Ports ports;
  } cases[] = {
      {"6501-6504", {6501, 6502, 6503, 6504}},
      // With a deadman the emergency port is its own.
      {"6501-6503,6514", {6501, 6502, 6503, 6514}},
      {"6514,6501-6503", {6514, 6501, 6502, 6503}},
      {"6501,6502,7001,6504", {6501, 6502, 7001, 6504}},
      {"6501-6502,6511-6512", {6501, 6502, 6511, 6512}},
      {"6501-6501,6502-6502,6503,6504", {6501, 6502, 6503, 6504}},
      {"65532-65535", {65532, 65533, 65534, 65535}},
      {"0,0,0,0", {0, 0, 0, 0}},
  };
  for (const auto& c : cases) EXPECT_EQ(parse_port_list(c.text, "--ports"), c.ports) << c.text;
}

TEST(PortList, WhatIsNoneIsOneLineThatSaysWhatIsExpected) {
  const struct {
    const char* text;
    const char* why;
  } cases[] = {
      {"", "'' is not a port"},
      {"6501-6503", "these are 3 ports"},
      {"6501-6503,6514,6515", "these are 5 ports"},
      {"6501-6505", "these are 5 ports"},
      {"0-65535", "these are 65536 ports"},
      {"6504-6501", "the range is empty"},
      {"6501-6503,6502", "port 6502 has two roles"},
      {"6501-6503,", "'' is not a port"},
      {",6501-6503", "'' is not a port"},
      {"6501-6503,,6514", "'' is not a port"},
      {"6501-", "'' is not a port"},
      {"6501-6502-6504", "'6502-6504' is not a port"},
      {"6501-6503, 6514", "' 6514' is not a port"},
      {"6501-6503;6514", "'6503;6514' is not a port"},
      {"6501-6503,65536", "'65536' is not a port"},
      {"6501-6503,-6514", "'' is not a port"},
      {"6501-6503,+6514", "'+6514' is not a port"},
      {"6501-6503,99999999999999999999", "'99999999999999999999' is not a port"},
  };
  for (const auto& c : cases) {
    try {
      parse_port_list(c.text, "--ports");
      ADD_FAILURE() << c.text << " was taken";
    } catch (const UserError& error) {
      const std::string words = error.what();
      EXPECT_EQ(words.find("--ports '" + std::string(c.text) + "': " + c.why), 0u) << words;
      EXPECT_NE(words.find("e.g. 6501-6504 or 6501-6503,6514"), std::string::npos) << words;
      EXPECT_EQ(words.find('\n'), std::string::npos);
    }
  }
}

// What is written in the documents and in the settings that are delivered is understood; at least once in the
// form with a deadman.
TEST(PortList, WhatTheDocumentsWriteIsUnderstood) {
  const std::regex ports("--ports ([0-9][0-9,-]*)");
  int found = 0, with_a_deadman = 0;
  for (const char* folder : {"deploy", "nve_server/afm"}) {
    for (const auto& entry :
         std::filesystem::recursive_directory_iterator(std::filesystem::path(TELENANO_SOURCE_DIR) / folder)) {
      const std::string kind = entry.path().extension().string();
      if (kind != ".md" && kind != ".toml" && kind != ".env") continue;
      std::ifstream file(entry.path());
      const std::string text{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
      for (std::sregex_iterator it(text.begin(), text.end(), ports), end; it != end; ++it) {
        const std::string list = (*it)[1];
        SCOPED_TRACE(entry.path().string());
        EXPECT_NO_THROW(EXPECT_EQ(parse_port_list(list, "--ports").size(), 4u)) << list;
        ++found;
        if (list.find(',') != std::string::npos) ++with_a_deadman;
      }
    }
  }
  EXPECT_GE(found, 4);
  EXPECT_GE(with_a_deadman, 3);
}

}  // namespace
}  // namespace telenano::app

// A key put into a scene's text.
#include "telenano/nve_server/fit/fitted_scene.h"

#include <gtest/gtest.h>

namespace telenano::fit {
namespace {

TEST(WithKey, ReplacesAddsAndLeavesTheRest) {
  const std::string text =
      "name = \"a\"   # of mine\n[sample]  # soft\nx = 1\n  y= 2 # old\n[probe]\nx = 3\n";
  EXPECT_EQ(with_key(text, "sample", "y", "5"),
            "name = \"a\"   # of mine\n[sample]  # soft\nx = 1\ny = 5   # fitted\n[probe]\nx = 3\n");
  EXPECT_EQ(with_key(text, "probe", "x", "5"),
            "name = \"a\"   # of mine\n[sample]  # soft\nx = 1\n  y= 2 # old\n[probe]\nx = 5   # fitted\n");
  EXPECT_EQ(
      with_key(text, "sample", "z", "5"),
      "name = \"a\"   # of mine\n[sample]  # soft\nz = 5   # fitted\nx = 1\n  y= 2 # old\n[probe]\nx = 3\n");
  EXPECT_EQ(with_key(text, "probe", "z", "5"), text.substr(0, text.size() - 6) + "z = 5   # fitted\nx = 3\n");
  EXPECT_EQ(with_key(text, "contact", "z", "5"), text + "\n[contact]\nz = 5   # fitted\n");
  // Not a key that begins like it, nor a table below it.
  EXPECT_EQ(with_key("[probe.tip]\nx = 1\n", "probe", "x", "5"),
            "[probe.tip]\nx = 1\n\n[probe]\nx = 5   # fitted\n");
  EXPECT_EQ(with_key("[a]\nxy = 1", "a", "x", "5"), "[a]\nx = 5   # fitted\nxy = 1\n");
}

TEST(WithoutKey, TakesThatLineOnly) {
  const std::string text = "[contact]\nhamaker_aj = 1 # mine\nlaw = \"dmt\"\n[other]\nhamaker_aj = 2\n";
  EXPECT_EQ(without_key(text, "contact", "hamaker_aj"),
            "[contact]\nlaw = \"dmt\"\n[other]\nhamaker_aj = 2\n");
  EXPECT_EQ(without_key(text, "contact", "hamaker"), text);
}

}  // namespace
}  // namespace telenano::fit

#include "telenano/common/link/practice_link.h"

#include <gtest/gtest.h>

#include "telenano/common/base/error.h"

namespace telenano::link {
namespace {

TEST(PracticeLink, IsReadFromAFlag) {
  const PracticeLink link = parse_practice_link("rtt=120,jitter=5,loss=2.5", "--practice-link");
  EXPECT_EQ(link.rtt_ms, 120);
  EXPECT_EQ(link.jitter_ms, 5);
  EXPECT_EQ(link.loss, 0.025);
  EXPECT_EQ(practice_text(link), "+120 ms, jitter 5 ms, 2.5 % lost");
  EXPECT_FALSE(parse_practice_link("off", "x").any());
  EXPECT_EQ(practice_text({}), "");
  EXPECT_EQ(practice_text({0, 0, 0.05}), "5 % lost");
  for (const char* bad :
       {"", "rtt", "rtt=", "rtt=-1", "rtt=nan", "rtt=3000", "loss=60", "delay=5", "rtt=1,", "rtt=1;loss=2"})
    EXPECT_THROW(parse_practice_link(bad, "--practice-link"), UserError) << bad;
}

}  // namespace
}  // namespace telenano::link

#include "telenano/master/view_model/start_plan.h"

#include <gtest/gtest.h>

namespace telenano::view_model {
namespace {

const std::string kTable =
    "key,value,unit\nmethod,twin,\nround_trip_median,20.04,ms\nbinding,device,\nscene,flakes,\n"
    "felt_per_nanonewton,0.019,N/nN\n";
const std::string kTouch =
    "felt,touch,\npress_depth,5,nm\npress_force,61,nN\nfelt_press,1.16,N\npull_off_force,40.1,nN\n"
    "felt_pull_off,0.762,N\n";

std::string words(const std::string& csv, bool shows_force = true) {
  std::string all;
  for (const std::string& line : plan_text(parse_plan(csv), shows_force)) all += line + "\n";
  return all;
}

TEST(StartPlan, WhatWillBeFeltIsSaidInNewtons) {
  EXPECT_EQ(words(kTable + kTouch),
            "Scene: flakes\nRound trip 20 ms, method twin\n19 mN at the hand for 1 nN at the tip\n"
            "Pressed 5 nm by a stiff hand 1.2 N; pull-off 0.76 N\n");
  EXPECT_NE(words(kTable + kTouch, false).find("no motors"), std::string::npos);
}

TEST(StartPlan, WhatIsNotKnownIsNotSaid) {
  const std::string unknown = words(kTable + "felt,unknown,\n");
  EXPECT_NE(unknown.find("are not known before\n"), std::string::npos);
  EXPECT_EQ(unknown.find("pull-off 0"), std::string::npos);
  EXPECT_NE(words(kTable + "felt,no_touch,\npress_depth,5,nm\n").find("meets no sample"), std::string::npos);
  const std::string unsafe = words("method,ks,\nbinding,nothing_is_safe,\nscene,flakes,\n");
  EXPECT_NE(unsafe.find("No scale is safe"), std::string::npos);
  EXPECT_EQ(unsafe.find("1 nN"), std::string::npos);
}

// Each of the causes as the plan has it, and no other one's words.
TEST(StartPlan, WhyTouchIsNotKnownIsSaid) {
  for (const std::string why :
       {"this server does not share its scene",
        "after 16 s the server's scene is still being fetched: 43 % is here; ask again",
        "the server's scene cannot be used: a, b; the session goes on without"}) {
    const std::string text = words(kTable + "felt,unknown,\nfelt_unknown_because," + why + ",\n");
    EXPECT_NE(text.find("Touch and pull-off are not known before: " + why + "\n"), std::string::npos) << text;
  }
}

TEST(StartPlan, TheScenesOfAServerAreInItsOrder) {
  EXPECT_TRUE(parse_plan(kTable).scenes.empty());
  EXPECT_EQ(parse_plan(kTable + "scene_1,flakes,\nscene_2,a, b,\nscene_4,lost,\n").scenes,
            (std::vector<std::string>{"flakes", "a, b"}));
}

TEST(StartPlan, AnyTextIsTaken) {
  for (const char* text : {"", "\n\n", "a", ",,,,\n", "felt,touch,\nfelt_press,abc,N\n", "binding,device"})
    EXPECT_FALSE(plan_text(parse_plan(text), true).empty());
}

}  // namespace
}  // namespace telenano::view_model

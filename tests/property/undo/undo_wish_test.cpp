#include "telenano/master/loop/undo_wish.h"

#include <gtest/gtest.h>

namespace telenano::loop {
namespace {

TEST(UndoWish, AsksUntilItIsAnsweredAndAgainOnlyAfterAClearAnswer) {
  UndoWish wish;
  EXPECT_EQ(wish.flag(5), 0u);
  ASSERT_TRUE(wish.ask(0));
  EXPECT_FALSE(wish.ask(0)) << "one at a time";
  EXPECT_EQ(wish.flag(6), link::kFlagUndo);
  wish.on_reply(5, 0);
  EXPECT_EQ(wish.answer(), UndoAnswer::kAsked) << "an answer to an earlier command";
  EXPECT_EQ(wish.flag(7), link::kFlagUndo);
  wish.on_reply(7, 0);
  EXPECT_EQ(wish.answer(), UndoAnswer::kDone);
  EXPECT_EQ(wish.flag(8), 0u);
  EXPECT_FALSE(wish.ask(0)) << "the server has not seen it clear";
  wish.on_reply(7, 0);
  EXPECT_FALSE(wish.ask(0));
  wish.on_reply(8, 0);
  ASSERT_TRUE(wish.ask(0));
  EXPECT_EQ(wish.flag(9), link::kFlagUndo);
  wish.on_reply(9, link::kFaultUndo);
  EXPECT_EQ(wish.answer(), UndoAnswer::kRefused);
}

TEST(UndoWish, GivesUpAfterATimeAndWithTheSession) {
  UndoWish wish;
  ASSERT_TRUE(wish.ask(0));
  EXPECT_EQ(wish.flag(1), link::kFlagUndo);
  wish.on_time(UndoWish::kPatience_ns - 1);
  EXPECT_EQ(wish.answer(), UndoAnswer::kAsked);
  wish.on_time(UndoWish::kPatience_ns);
  EXPECT_EQ(wish.answer(), UndoAnswer::kNoAnswer);
  EXPECT_EQ(wish.flag(2), 0u);
  wish.on_reply(2, 0);
  ASSERT_TRUE(wish.ask(0));
  EXPECT_EQ(wish.flag(3), link::kFlagUndo);
  wish.on_session();
  EXPECT_EQ(wish.answer(), UndoAnswer::kNoAnswer);
  EXPECT_EQ(wish.flag(1), 0u);
}

}  // namespace
}  // namespace telenano::loop

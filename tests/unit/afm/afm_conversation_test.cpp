// What the controller is told, byte for byte and at which time: recorded numbers, so that a change which is
// not meant to change the conversation can show that it does not.
#include <gtest/gtest.h>

#include "tests/unit/afm/afm_bench.h"

namespace telenano::afm {
namespace {

struct Recorded {
  std::uint64_t requests = 0;
  std::uint64_t fingerprint = 0;
};

void expect_conversation(const Bench& b, const Recorded& recorded) {
  EXPECT_EQ(b.afm->requests(), recorded.requests);
  EXPECT_EQ(b.afm->conversation(), recorded.fingerprint) << std::hex << "0x" << b.afm->conversation();
}

/// From the checks over a touch, a way across and an error of the controller's to the end with everything
/// given back.
void whole_session(Bench& b) {
  b.config.along_slope = 0.3;  // a way along the lever is part of it
  b.start();
  ASSERT_TRUE(b.until(Phase::kFollowing)) << b.afm->logic().refusal() << b.afm->logic().news();
  b.follow(Vec3(0, 0, -5));
  b.run(300);
  b.follow(Vec3(12, -7, 3));
  b.run(300);
  b.afm->cut(150 * kMs);
  ASSERT_TRUE(b.until(Phase::kWithdrawn));
  ++b.wish.clears;
  ASSERT_TRUE(b.until(Phase::kFollowing)) << b.afm->logic().news();
  b.run(200);
  b.afm->logic().withdraw(Cause::kExit, b.afm->now_ns());
  ASSERT_TRUE(b.until(Phase::kWithdrawn));
  b.run(1000);
  EXPECT_TRUE(b.afm->logic().finished());
}

TEST(AfmConversation, IsThatOfTheRecordingFromTheChecksToTheEnd) {
  Bench b;
  whole_session(b);
  expect_conversation(b, {3453, 0xa765f2498445d848});
}

TEST(AfmConversation, IsThatOfTheRecordingWhereLargerZIsTowardsTheSample) {
  Bench b;
  b.config.z_sign = b.rig.z_sign = -1;
  whole_session(b);
  expect_conversation(b, {3453, 0xbcd5fbc9e7e66418});
}

TEST(AfmConversation, IsThatOfTheRecordingWhereTheSetPointIsRefused) {
  Bench b;
  b.rig.setpoint_nn = 2000;
  b.start();
  ASSERT_TRUE(b.until(Phase::kRefused));
  b.run(1000);
  EXPECT_TRUE(b.afm->logic().finished());
  expect_conversation(b, {51, 0xf2edd6e505cafb74});
}

}  // namespace
}  // namespace telenano::afm

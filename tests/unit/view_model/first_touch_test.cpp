#include "telenano/master/view_model/first_touch.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "telenano/common/link/messages.h"
#include "telenano/master/station/station.h"

namespace telenano::view_model {
namespace {

using Step = FirstTouch::Step;
using Hand = FirstTouch::Hand;

const Ground& plane() {
  static const Ground ground(0, Vec3(-50, -50, -20), Vec3(50, 50, 100));
  return ground;
}

/// A tip that is led along z over a surface that pulls with up to `pull_nn` and pushes with 6 N/m.
class Session {
 public:
  explicit Session(double pull_nn) : pull_nn_(pull_nn) {}

  void go(double to_nm, station::Mode mode = station::Mode::kEngaged) {
    constexpr double kStep_nm = 0.05;
    for (bool there = false; !there;) {
      there = std::abs(to_nm - z_nm_) <= kStep_nm;
      z_nm_ = there ? to_nm : z_nm_ + (to_nm > z_nm_ ? kStep_nm : -kStep_nm);
      recording::Sample s;
      s.tick = ++tick_;
      s.time_s = 1e-3 * static_cast<double>(tick_);
      s.reply_sequence = reply_ = tick_;
      s.station_mode = static_cast<std::uint32_t>(mode);
      s.force_scale = 2e7;
      s.tip_pos_w_nm = {0, 0, z_nm_};
      const double pull = -pull_nn_ * std::exp(-std::abs(z_nm_) / 2);
      s.force_w_nn = {0, 0, z_nm_ < 0 ? -6 * z_nm_ + pull : pull};
      s.contact_state =
          static_cast<std::uint32_t>(z_nm_ < 0 ? link::ContactState::kContact : link::ContactState::kFree);
      live.take(s, plane());
      guide.update(live);
    }
  }

  /// Goes there while no reply comes.
  void silent(double to_nm) {
    z_nm_ = to_nm;
    for (int i = 0; i < 400; ++i) {
      recording::Sample s;
      s.tick = ++tick_;
      s.time_s = 1e-3 * static_cast<double>(tick_);
      s.reply_sequence = reply_;
      s.station_mode = static_cast<std::uint32_t>(station::Mode::kHeld);
      s.force_scale = 2e7;
      s.tip_pos_w_nm = {0, 0, -1};
      s.contact_state = static_cast<std::uint32_t>(link::ContactState::kContact);
      live.take(s, plane());
      guide.update(live);
    }
  }

  LiveSession live{0.25};
  FirstTouch guide;

 private:
  double pull_nn_;
  double z_nm_ = 30;
  std::int64_t tick_ = 0;
  std::uint64_t reply_ = 0;
};

TEST(FirstTouch, FiveStepsEndWithAPullOffInNewtons) {
  Session session(3);
  EXPECT_EQ(session.guide.title(), "First touch, step 1 of 5");
  session.go(29, station::Mode::kReady);
  EXPECT_EQ(session.guide.step(), Step::kHold) << "nobody holds it";
  session.go(28);
  EXPECT_EQ(session.guide.step(), Step::kApproach);
  EXPECT_NE(session.guide.words(session.live, Hand::kMouse, false).find("28.0 nm"), std::string::npos);
  session.go(4);
  EXPECT_EQ(session.guide.step(), Step::kTouch);
  session.go(-0.1);
  EXPECT_EQ(session.guide.step(), Step::kPress);
  session.go(-1);
  EXPECT_EQ(session.guide.step(), Step::kPullOff);
  EXPECT_EQ(session.guide.title(), "First touch, step 5 of 5");
  session.go(15);
  EXPECT_EQ(session.guide.step(), Step::kDone);
  EXPECT_EQ(session.guide.words(session.live, Hand::kDevice, true),
            "Pull-off: it held on with 3.00 nN, 0.06 N at the hand, and let go. G closes this");
  EXPECT_EQ(session.guide.words(session.live, Hand::kMouse, false).find("at the hand"), std::string::npos)
      << "a mouse feels nothing";
}

TEST(FirstTouch, NoPullIsNotToldForOne) {
  Session session(0);
  session.go(-2);
  session.go(15);
  EXPECT_EQ(session.guide.step(), Step::kDone);
  EXPECT_NE(session.guide.words(session.live, Hand::kDevice, true).find("does not adhere"),
            std::string::npos);
}

TEST(FirstTouch, WhoPullsBackBeforePressingHasFeltIt) {
  Session session(3);
  session.go(-0.1);
  EXPECT_EQ(session.guide.step(), Step::kPress);
  session.go(15);
  EXPECT_EQ(session.guide.step(), Step::kDone);
}

TEST(FirstTouch, AStopIsToldAndLosesNoStep) {
  Session session(3);
  session.go(4);
  session.go(20, station::Mode::kStopped);
  for (const Hand hand : {Hand::kMouse, Hand::kDevice, Hand::kSimulated})
    EXPECT_NE(session.guide.words(session.live, hand, true).find("(R)"), std::string::npos);
  EXPECT_EQ(session.guide.step(), Step::kTouch);
}

// As a busy machine does it: the session is held on the way up, and the curve of that way ends there.
TEST(FirstTouch, AWayUpThatWasNotSeenIsAskedForOnceMore) {
  Session session(3);
  session.go(-1);
  EXPECT_EQ(session.guide.step(), Step::kPullOff);
  session.silent(20);
  session.go(25);
  EXPECT_EQ(session.guide.step(), Step::kApproach);
  for (const Hand hand : {Hand::kMouse, Hand::kDevice, Hand::kSimulated})
    EXPECT_NE(session.guide.words(session.live, hand, true).find("once more"), std::string::npos);
  session.go(-1);
  EXPECT_EQ(session.guide.step(), Step::kPullOff);
  session.go(15);
  EXPECT_EQ(session.guide.step(), Step::kDone);
}

TEST(FirstTouch, EveryStepHasWordsForEveryHand) {
  Session session(3);
  for (const double z_nm : {29.0, 3.0, -0.1, -1.0, 15.0}) {
    session.go(z_nm);
    for (const Hand hand : {Hand::kMouse, Hand::kDevice, Hand::kSimulated})
      EXPECT_FALSE(session.guide.words(session.live, hand, true).empty());
  }
}

}  // namespace
}  // namespace telenano::view_model

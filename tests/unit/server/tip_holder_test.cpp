// Who may move a shared tip, rule by rule; and whose energy is whose.
#include "telenano/nve_server/server/tip_holder.h"

#include <gtest/gtest.h>

#include "telenano/common/link/messages.h"
#include "telenano/nve_server/server/port_account.h"

namespace telenano::server {
namespace {

using net::Rights;
constexpr std::uint32_t kEngaged = link::kFlagClutch | link::kFlagDeadman;
constexpr std::uint32_t kAsk = kEngaged | link::kFlagTakeOver;
constexpr std::uint32_t kGive = kEngaged | link::kFlagHandOver;
constexpr std::int64_t kSecond = 1'000'000'000;

struct Tip : testing::Test {
  bool says(std::size_t slot, std::uint32_t flags, Rights rights = Rights::kOperate) {
    return holder.on_command(slot, rights, flags, now_ns += 1'000'000);
  }
  TipHolder holder{4};
  std::int64_t now_ns = 0;
};

TEST_F(Tip, GoesToTheFirstThatMayOperate) {
  EXPECT_FALSE(says(0, kEngaged, Rights::kObserve));
  EXPECT_FALSE(says(1, kGive)) << "does not want it";
  EXPECT_EQ(holder.holder(), TipHolder::kNobody);
  EXPECT_TRUE(says(2, 0)) << "engaged or not";
  EXPECT_EQ(holder.number(), 1u);
  EXPECT_FALSE(says(2, kEngaged)) << "it has it";
  EXPECT_FALSE(says(3, kEngaged));
  EXPECT_FALSE(says(3, kEngaged, Rights::kAdminister)) << "who may take it must ask";
  EXPECT_TRUE(holder.holds(2));
}

TEST_F(Tip, AnOperatorWaitsUntilTheHolderLetsGo) {
  EXPECT_TRUE(says(0, kEngaged));
  for (int i = 0; i < 5000; ++i) {
    EXPECT_FALSE(says(1, kAsk));
    EXPECT_FALSE(says(0, kEngaged));
  }
  EXPECT_FALSE(says(0, kGive));
  EXPECT_EQ(holder.holder(), TipHolder::kNobody);
  EXPECT_TRUE(says(1, kAsk)) << "its asking was still open";
  EXPECT_FALSE(says(0, kEngaged)) << "must ask now";
}

TEST_F(Tip, AHolderThatDoesNotEngageLosesItToWhoAsks) {
  EXPECT_TRUE(says(0, kEngaged));
  EXPECT_FALSE(says(1, 0));
  now_ns += TipHolder::kReleasedNs - 3'000'000;
  EXPECT_FALSE(says(0, link::kFlagDeadman)) << "the clutch is open";
  EXPECT_FALSE(says(1, kAsk)) << "not long enough";
  EXPECT_FALSE(says(2, kEngaged)) << "who does not ask gets nothing of a held tip";
  EXPECT_TRUE(says(1, kAsk)) << "asking goes on as long as the flag is set";
  EXPECT_EQ(holder.number(), 2u);
  EXPECT_FALSE(says(0, kEngaged));
}

TEST_F(Tip, WhoAdministersTakesItAtOnceAndTwoOfThemDoNotFight) {
  EXPECT_TRUE(says(0, kAsk, Rights::kAdminister));
  EXPECT_TRUE(says(1, kAsk, Rights::kAdminister));
  for (int i = 0; i < 10; ++i) EXPECT_FALSE(says(0, kAsk, Rights::kAdminister)) << "its asking is used up";
  EXPECT_FALSE(says(0, kEngaged, Rights::kAdminister));
  EXPECT_TRUE(says(0, kAsk, Rights::kAdminister)) << "asked anew";
  EXPECT_EQ(holder.number(), 3u);
}

TEST_F(Tip, ALostRightLetsGo) {
  EXPECT_TRUE(says(0, kEngaged));
  EXPECT_FALSE(says(0, kEngaged, Rights::kObserve));
  EXPECT_EQ(holder.holder(), TipHolder::kNobody);
  EXPECT_FALSE(says(0, kAsk, Rights::kObserve));
  EXPECT_TRUE(says(0, kAsk)) << "and may ask again when it is back";
}

TEST_F(Tip, IsWithdrawnWhenLeftAndNobodyGetsItMeanwhileButWhoAdministers) {
  EXPECT_FALSE(holder.must_withdraw(now_ns, 2 * kSecond)) << "never held";
  EXPECT_TRUE(says(0, kEngaged));
  EXPECT_FALSE(holder.must_withdraw(now_ns + 100 * kSecond, 2 * kSecond)) << "held";
  holder.leave(0, now_ns);
  EXPECT_TRUE(holder.must_withdraw(now_ns, 2 * kSecond));
  EXPECT_FALSE(says(1, kAsk));
  EXPECT_FALSE(says(2, kEngaged)) << "begins, and waits";
  holder.withdrawn();
  EXPECT_FALSE(holder.must_withdraw(now_ns + 100 * kSecond, 2 * kSecond)) << "once";
  EXPECT_TRUE(says(2, kEngaged)) << "free, and it had not been told no";
  holder.leave(2, now_ns);
  EXPECT_TRUE(holder.must_withdraw(now_ns, 2 * kSecond));
  EXPECT_TRUE(says(3, kAsk, Rights::kAdminister));
  EXPECT_FALSE(holder.must_withdraw(now_ns, 2 * kSecond));
}

TEST_F(Tip, HandedOverStaysWhereItIsForAWhile) {
  EXPECT_TRUE(says(0, kEngaged));
  EXPECT_FALSE(says(0, kGive));
  EXPECT_FALSE(holder.must_withdraw(now_ns + 2 * kSecond, 2 * kSecond));
  EXPECT_TRUE(holder.must_withdraw(now_ns + 2 * kSecond + 1, 2 * kSecond)) << "nobody looks after it";
  holder.withdrawn();
  EXPECT_FALSE(says(0, kEngaged)) << "must ask: it does not begin";
  EXPECT_TRUE(says(0, kAsk));
}

TEST_F(Tip, OfASessionThatEndedIsNotTakenAlongByTheNextInItsSlot) {
  EXPECT_TRUE(says(0, kAsk));
  holder.leave(0, now_ns);
  holder.begin_session(0);
  EXPECT_FALSE(says(0, kEngaged)) << "on its way up";
  holder.withdrawn();
  EXPECT_TRUE(says(0, kEngaged));
}

TEST_F(Tip, ResumingDoesNotTakeItBackFromWhoTookItMeanwhile) {
  EXPECT_TRUE(says(0, kAsk, Rights::kAdminister));
  EXPECT_TRUE(says(1, kAsk, Rights::kAdminister));
  holder.resume_session(0);
  EXPECT_FALSE(says(0, kAsk, Rights::kAdminister));
  EXPECT_FALSE(says(1, kAsk | link::kFlagHandOver, Rights::kAdminister));
  holder.resume_session(0);
  EXPECT_TRUE(says(0, kAsk, Rights::kAdminister)) << "a free one it may have back";
}

slave::SlaveOutput at(double in_aj, double out_aj, link::ContactState contact) {
  slave::SlaveOutput o;
  o.energy_in_aj = in_aj;
  o.energy_out_aj = out_aj;
  o.contact_state = contact;
  return o;
}

TEST(PortAccount, CreditsWhatOneHasPutInOneself) {
  using link::ContactState;
  // Another one has put 100 aJ into the spring, and has let go.
  PortAccount account;
  const auto taken = at(100, 3, ContactState::kContact);
  account.take_over(taken);
  EXPECT_EQ(account.in_aj() + account.out_aj(), 0);
  const auto deeper = at(110, 3, ContactState::kContact);
  account.add(taken, deeper);
  EXPECT_EQ(account.in_aj(), 10);
  const auto higher = at(110, 33, ContactState::kContact);
  account.add(deeper, higher);
  EXPECT_EQ(account.out_aj(), 10) << "of 30 that came out, 10 were its own";
  const auto free = at(110, 100, ContactState::kFree);
  account.add(higher, free);
  EXPECT_EQ(account.out_aj(), 10);
  // From now on nothing of the other's is left: a sample that attracts gives before it takes.
  const auto attracted = at(110, 104, ContactState::kVanDerWaals);
  account.add(free, attracted);
  EXPECT_EQ(account.out_aj(), 14);
  EXPECT_EQ(account.seen(attracted).energy_out_aj, 14);
  EXPECT_EQ(account.seen(attracted).energy_in_aj, 10);
}

}  // namespace
}  // namespace telenano::server

// The instrument reads back what a scripted touch was made of. Force and folds come from Maugis' equations,
// the energy that is lost from the drops of the total energy at the two instabilities, not from any path.
#include "telenano/master/view_model/force_curve.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "telenano/common/link/messages.h"
#include "telenano/nve_server/physics/contact/maugis_dugdale.h"

namespace telenano::view_model {
namespace {

using State = ForceCurve::State;

constexpr double kUnit_nn = 20;  // u_F
constexpr double kUnit_nm = 2;   // u_delta
constexpr double kCompliance = 2;
constexpr double kLever_n_m = kUnit_nn / (kCompliance * kUnit_nm);  // nN/nm = N/m
constexpr double kStep = 0.004;                                     // of Z, a reply
constexpr double kTop = -6;                                         // of Z
constexpr double kBottom = 3;

// A lever with compliance goes down on a sphere and up again. Z is what the base holds, positive downwards.
class Touch {
 public:
  explicit Touch(ForceCurve& curve) : curve_(curve) {}

  physics::Held held() const { return {1, kCompliance}; }
  const physics::MaugisDugdale& law() const { return law_; }

  void go(double from, double to) {
    const int steps = static_cast<int>(std::lround(std::abs(to - from) / kStep));
    for (int i = 0; i <= steps; ++i) at(from + (to - from) * i / steps, to < from);
  }
  void at(double z, bool up) {
    const physics::CurvePoint fold = law_.fold(held());
    const double fold_z = fold.overlap + kCompliance * fold.load;
    if (!touching_ && !up && z >= -law_.range()) touching_ = true;  // the stress acts from H0 on
    if (touching_ && z < fold_z) touching_ = false;
    double load = 0;
    double overlap = z;
    bool contact = false;
    if (touching_) {
      const physics::CurvePoint p = law_.solve(z, held()).point;
      load = p.load;
      overlap = z - kCompliance * load;
      contact = true;
    }
    recording::Sample s;
    s.reply_sequence = ++reply_;
    s.time_s = time_s_ += 1e-3;
    s.force_w_nn = {side_nn, 0, kUnit_nn * load + noise()};
    s.tip_pos_w_nm = {0, 0, 7 - kUnit_nm * overlap};
    s.deflection_nm = kUnit_nn * load / kLever_n_m;
    s.contact_state =
        static_cast<std::uint32_t>(contact ? link::ContactState::kContact : link::ContactState::kFree);
    if (observes) s.limit_flags = recording::kLimitObserves;
    // What the hand is given is no source: the force of a model, or none.
    s.hand_force_scaled_h_n = s.hand_force_rendered_h_n = {9, 9, hand_n};
    curve_.take(s, -kUnit_nm * overlap);
    curve_.take(s, -kUnit_nm * overlap);  // the loop is faster than the replies
  }
  void silence(double s) { time_s_ += s; }

  double side_nn = 0;
  double hand_n = 0;
  double noise_nn = 0;
  bool observes = false;

 private:
  double noise() { return noise_nn > 0 ? noise_nn * normal_(random_) : 0; }

  ForceCurve& curve_;
  physics::MaugisDugdale law_{1};
  bool touching_ = false;
  std::int64_t reply_ = 0;
  double time_s_ = 0;
  std::mt19937 random_{7};
  std::normal_distribution<double> normal_;
};

double snapped_load(const Touch& touch) {
  return touch.law().solve(-touch.law().range(), touch.held()).point.load;
}

// Of tip, sample and lever: the spring has c P²/2.
double total_energy(const physics::CurvePoint& p) {
  return p.energy + 0.5 * kCompliance * p.load * p.load;
}

// Lost at both instabilities; without contact the energy is 0.
double lost_aj(const Touch& touch) {
  const physics::CurvePoint in = touch.law().solve(-touch.law().range(), touch.held()).point;
  const physics::CurvePoint out = touch.law().fold(touch.held());
  return kUnit_nn * kUnit_nm * (total_energy(out) - total_energy(in));
}

TEST(ForceCurve, ReadsSnapInPullOffAndTheEnergyLostOfAMaugisContact) {
  ForceCurve curve;
  Touch touch(curve);
  touch.go(kTop, kBottom);
  ASSERT_EQ(curve.approach().state, State::kUnderWay);
  touch.go(kBottom, kTop);
  ASSERT_EQ(curve.approach().state, State::kDone);
  ASSERT_EQ(curve.retract().state, State::kDone);
  const auto in = curve.snap_in();
  const auto out = curve.pull_off();
  ASSERT_TRUE(in && out);
  // One reply is kStep of Z. The load moves along the stable branch by dP/dZ ≤ 1/c for each of it, and like
  // the root of the way near the fold, where the curvature of Z over P is of order 1: sqrt(2 kStep) < 0.1.
  EXPECT_NEAR(in->force_nn, kUnit_nn * snapped_load(touch), kUnit_nn * kStep);
  EXPECT_TRUE(in->leapt);
  EXPECT_NEAR(in->leap_from_nm, kUnit_nm * touch.law().range(), 1.01 * kUnit_nm * kStep);
  const physics::CurvePoint fold = touch.law().fold(touch.held());
  EXPECT_NEAR(out->force_nn, kUnit_nn * fold.load, kUnit_nn * 0.1);
  EXPECT_NEAR(out->distance_nm, -kUnit_nm * fold.overlap, kUnit_nm * 0.2);
  EXPECT_TRUE(out->leapt);
  EXPECT_NEAR(out->leap_to_nm, -kUnit_nm * (fold.overlap + kCompliance * fold.load), 1.01 * kUnit_nm * kStep);
  // A base that steps loses at most kStep times the greatest load more at each instability.
  const auto lost = curve.hysteresis_aj();
  ASSERT_TRUE(lost);
  EXPECT_GT(lost_aj(touch), 10);
  EXPECT_NEAR(*lost, lost_aj(touch),
              2 * kUnit_nn * kUnit_nm * kStep * std::abs(fold.load) + 1e-3 * lost_aj(touch));
}

// Noise of 2 % of the pull: the extreme of some hundred values lies up to four deviations out; what is lost
// is a mean.
TEST(ForceCurve, NoiseMovesTheNumbersByItselfAndNoMore) {
  ForceCurve curve;
  Touch touch(curve);
  touch.noise_nn = 0.6;
  touch.go(kTop, kBottom);
  touch.go(kBottom, kTop);
  EXPECT_NEAR(curve.noise_nn(), touch.noise_nn, 0.15 * touch.noise_nn);
  ASSERT_TRUE(curve.snap_in() && curve.pull_off() && curve.hysteresis_aj());
  EXPECT_NEAR(curve.snap_in()->force_nn, kUnit_nn * snapped_load(touch), 4 * touch.noise_nn);
  EXPECT_NEAR(curve.pull_off()->force_nn, kUnit_nn * touch.law().fold(touch.held()).load,
              4 * touch.noise_nn + 2);
  EXPECT_TRUE(curve.pull_off()->leapt);
  EXPECT_NEAR(*curve.hysteresis_aj(), lost_aj(touch), 0.05 * lost_aj(touch));
}

TEST(ForceCurve, NoiseAloneIsNoAttraction) {
  ForceCurve curve;
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  std::int64_t reply = 0;
  for (int segment = 0; segment < 2; ++segment) {
    for (int i = 0; i <= 400; ++i) {
      const double gap = (segment == 0 ? 400 - i : i) * 0.05 - 5;
      recording::Sample s;
      s.reply_sequence = ++reply;
      s.time_s = 1e-3 * static_cast<double>(reply);
      s.force_w_nn[2] = (gap < 0 ? -6 * gap : 0) + 0.1 * normal(random);
      s.tip_pos_w_nm[2] = gap;
      s.contact_state =
          static_cast<std::uint32_t>(gap < 0 ? link::ContactState::kContact : link::ContactState::kFree);
      curve.take(s, gap);
    }
  }
  ASSERT_EQ(curve.retract().state, State::kDone);
  EXPECT_FALSE(curve.snap_in());
  EXPECT_FALSE(curve.pull_off());
  // Down and up the same way. 2 · 100 steps of 0.05 nm under noise: 0.05 · 0.1 · sqrt(800) = 0.14 aJ.
  EXPECT_NEAR(curve.hysteresis_aj().value(), 0, 5 * 0.14);
}

TEST(ForceCurve, ARetractThatIsCutOffHasNoPullOff) {
  ForceCurve curve;
  Touch touch(curve);
  touch.go(kTop, kBottom);
  touch.go(kBottom, 0);
  EXPECT_EQ(curve.retract().state, State::kUnderWay);
  EXPECT_FALSE(curve.pull_off()) << "the most may be to come";
  touch.silence(1);
  touch.go(kTop, kTop + 1);
  EXPECT_EQ(curve.retract().state, State::kCutOff);
  EXPECT_FALSE(curve.pull_off());
  EXPECT_FALSE(curve.hysteresis_aj());
  EXPECT_TRUE(curve.snap_in()) << "the approach was whole";
  EXPECT_NE(curve.csv().find("# retract: cut off"), std::string::npos);
}

TEST(ForceCurve, APressAgainBelongsToTheSameTouch) {
  ForceCurve curve;
  Touch touch(curve);
  touch.go(kTop, kBottom);
  touch.go(kBottom, 1);
  touch.go(1, kBottom);
  EXPECT_EQ(curve.retract().state, State::kNone);
  touch.go(kBottom, kTop);
  ASSERT_TRUE(curve.hysteresis_aj());
  EXPECT_NEAR(*curve.hysteresis_aj(), lost_aj(touch), 0.02 * lost_aj(touch)) << "a press loses nothing";
  const double first_s = curve.approach().points.front().time_s;
  touch.go(kTop, kBottom);
  EXPECT_EQ(curve.retract().state, State::kNone) << "another touch's";
  EXPECT_GT(curve.approach().points.front().time_s, first_s);
}

// An observer's hand feels nothing, and the hand of a method with a model or a twin that is apart feels
// another force.
TEST(ForceCurve, IsTheTipsWhateverTheHandIsGiven) {
  ForceCurve plain;
  ForceCurve other;
  Touch a(plain);
  Touch b(other);
  b.observes = true;
  b.hand_n = -77;
  a.side_nn = b.side_nn = 1.5;
  for (Touch* touch : {&a, &b}) {
    touch->go(kTop, kBottom);
    touch->go(kBottom, kTop);
  }
  EXPECT_EQ(plain.csv(), other.csv());
  EXPECT_DOUBLE_EQ(other.retract().lateral_most_nn(), 1.5);
}

TEST(ForceCurve, NoPeakIsLostInALongTouch) {
  ForceCurve curve;
  std::int64_t reply = 0;
  const auto take = [&](double gap, double force) {
    recording::Sample s;
    s.reply_sequence = ++reply;
    s.time_s = 1e-3 * static_cast<double>(reply);
    s.force_w_nn[2] = force;
    s.tip_pos_w_nm[2] = gap;
    s.contact_state =
        static_cast<std::uint32_t>(gap < 0 ? link::ContactState::kContact : link::ContactState::kFree);
    curve.take(s, gap);
  };
  for (int i = 0; i < 100'000; ++i) take(10 - 1.2e-4 * i, i == 1234 ? -8 : 0);
  EXPECT_LE(curve.approach().points.size(), ForceCurve::kPointsMax);
  EXPECT_DOUBLE_EQ(curve.approach().points.front().distance_nm, 10);
  ASSERT_TRUE(curve.snap_in());
  EXPECT_DOUBLE_EQ(curve.snap_in()->force_nn, -8);
}

TEST(ForceCurve, TheTableHoldsUnitsMarksAndEveryPoint) {
  ForceCurve curve;
  EXPECT_NE(curve.csv().find("# approach: none"), std::string::npos);
  Touch touch(curve);
  touch.go(kTop, kBottom);
  touch.go(kBottom, kTop);
  const std::string csv = curve.csv();
  EXPECT_NE(csv.find("segment,time_s,distance_nm,height_nm,base_nm,force_nn,lateral_nn\n"),
            std::string::npos);
  for (const char* const word :
       {"# snap-in: -", " nN at ", "# pull-off: -", ", leap from ", "# hysteresis: ", " aJ\n"})
    EXPECT_NE(csv.find(word), std::string::npos) << word;
  const auto lines = static_cast<std::size_t>(std::count(csv.begin(), csv.end(), '\n'));
  EXPECT_EQ(lines, 8 + curve.approach().points.size() + curve.retract().points.size());
}

}  // namespace
}  // namespace telenano::view_model

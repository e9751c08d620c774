#include "telenano/common/link/priced_energy.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

namespace telenano::link {
namespace {

TEST(PricedEnergy, AtOnePriceItIsTheArgumentItself) {
  PricedEnergy sample;
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> some(0, 1e3);
  for (int k = 0; k < 10'000; ++k) {
    const double energy = some(random);
    ASSERT_EQ(random() % 2 != 0 ? sample.put_in(energy, 2e-5) : sample.take_out(energy, 2e-5), energy);
  }
}

TEST(PricedEnergy, WhatComesOutIsWorthTheLesserOfTwoPrices) {
  PricedEnergy sample;
  EXPECT_EQ(sample.put_in(100, 1), 100);
  EXPECT_EQ(sample.take_out(40, 4), 10);    // 40 paid at 1, counted at 4
  EXPECT_EQ(sample.take_out(40, 0.5), 40);  // cheaper now: what it is worth now
  EXPECT_EQ(sample.put_in(10, 4), 10);
  EXPECT_EQ(sample.take_out(30, 4), 10 + 20 * 0.25);  // the last in first
}

// A tip that snaps in gives out what nobody has put in. Pulled off at a lower price, it costs what it was
// credited.
TEST(PricedEnergy, TheWellIsPaidBackAtTheGreaterOfTwoPrices) {
  PricedEnergy sample;
  EXPECT_EQ(sample.take_out(100, 4), 100);
  EXPECT_EQ(sample.put_in(100, 1), 400);
  EXPECT_EQ(sample.take_out(100, 1), 100);
  EXPECT_EQ(sample.put_in(100, 4), 100);
}

// Whatever is done at whatever prices: nobody has been credited more than was charged and the well is worth
// at the dearest price, and with nothing left in the sample or owed by it no more than was charged. The
// oracle adds up hand joules and knows nothing of lots.
TEST(PricedEnergy, NoPathMakesEnergy) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> unit(0, 1);
  for (int run = 0; run < 300; ++run) {
    PricedEnergy sample;
    constexpr double kWell = 50;
    double in_it = 0, charged_j = 0, credited_j = 0, dearest = 0, price = 1, owed_dearest = 0;
    for (int k = 0; k < 500; ++k) {
      if (unit(random) < 0.3) price = 0.04 + 25 * unit(random) * unit(random);
      dearest = std::max(dearest, price);
      if (unit(random) < 0.5) {
        const double energy = 20 * unit(random);
        charged_j += price * sample.put_in(energy, price);
        in_it += energy;
      } else {
        const double energy = std::min(30 * unit(random), in_it + kWell);
        credited_j += price * sample.take_out(energy, price);
        in_it -= energy;
      }
      owed_dearest = std::max(0.0, -in_it) * dearest;
      ASSERT_LE(credited_j, charged_j + owed_dearest + 1e-6) << run << ' ' << k;
    }
    // Empty it: what it owes is paid back, whatever the price.
    if (in_it < 0) charged_j += 0.01 * sample.put_in(-in_it, 0.01);
    EXPECT_LE(credited_j, charged_j + 1e-6) << run;
  }
}

TEST(PricedEnergy, WhatIsLostInTheSampleStaysAtTheBottom) {
  PricedEnergy sample;
  sample.put_in(1e6, 1e-3);  // an hour of friction, cheap
  for (int k = 0; k < 100; ++k) {
    EXPECT_EQ(sample.put_in(10, 5), 10);
    EXPECT_EQ(sample.take_out(9, 5), 9) << "what is pressed now is worth what it is paid now";
  }
}

TEST(PricedEnergy, ManyPricesErrOnTheSafeSideOnly) {
  PricedEnergy sample;
  double charged_j = 0, credited_j = 0;
  for (int k = 1; k <= 1000; ++k) charged_j += k * sample.put_in(1, k);
  for (int k = 1; k <= 1000; ++k) credited_j += 1e4 * sample.take_out(1, 1e4);
  EXPECT_LE(credited_j, charged_j * (1 + 1e-12));
  EXPECT_GT(credited_j, 0.01 * charged_j);
}

}  // namespace
}  // namespace telenano::link

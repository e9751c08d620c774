#include "telenano/master/app/run/twin_cost.h"

#include <time.h>

#include <algorithm>
#include <vector>

#include "telenano/common/link/messages.h"

namespace telenano::app {
namespace {

constexpr int kGroup = 10;  // steps between two looks at the clock, which costs as much as a cheap step
constexpr int kDownMost = 5000, kAlong = 500, kUp = 300;
constexpr double kDownNm = 0.1, kDeepNm = 2, kAlongNm = 50;

/// Of this thread: whoever else uses the processor meanwhile does not make the twin dearer.
double processor_s() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// A touch: what each group of its steps costs, s a step. Leaves the twin as a new one.
void touch(control::LocalSlave& twin, double rate_hz, std::vector<double>& cost_s) {
  control::LocalAnswer answer;
  control::LocalStep step;
  step.dt_s = 1 / rate_hz;
  twin.step(step, answer);  // follows nothing: it says where it stands
  step.flags = link::kFlagClutch | link::kFlagDeadman;
  step.target_w_nm = answer.commanded_pos_w_nm;
  const auto go = [&](const Vec3& by_nm, int steps, bool until_touch) {
    const int groups = steps / kGroup;
    for (int group = 0; group < groups; ++group) {
      if (until_touch && answer.contact_state == static_cast<std::uint32_t>(link::ContactState::kContact))
        return;
      const double begin_s = processor_s();
      for (int i = 0; i < kGroup; ++i) {
        step.target_w_nm += by_nm;
        step.vel_w_nm_s = by_nm / step.dt_s;
        twin.step(step, answer);
      }
      cost_s.push_back((processor_s() - begin_s) / kGroup);
    }
  };
  go(Vec3(0, 0, -kDownNm), kDownMost, true);
  go(Vec3(0, 0, -kDownNm), static_cast<int>(kDeepNm / kDownNm), false);
  go(Vec3(kAlongNm / kAlong, 0, 0), kAlong, false);
  go(Vec3(0, 0, kDownNm), kUp, false);
  twin.reset();
}

}  // namespace

double twin_step_cost_s(control::LocalSlave& twin, double rate_hz) {
  std::vector<double> cost_s;
  cost_s.reserve((kDownMost + kAlong + kUp) / kGroup + 1);
  touch(twin, rate_hz,
        cost_s);  // what is made at the first look, such as the fields of a large scan, is no step's cost
  cost_s.clear();
  touch(twin, rate_hz, cost_s);
  std::sort(cost_s.begin(), cost_s.end());
  return cost_s[static_cast<std::size_t>(0.99 * static_cast<double>(cost_s.size() - 1))];
}

}  // namespace telenano::app

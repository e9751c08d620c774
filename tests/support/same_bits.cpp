// What the state of each scene of the project is after so many steps, as one number: the hashes of all states
// on the way, mixed in their order. Two builds, or one build on two processors, that print the same have gone
// through the same states to the bit.
//
//   telenano-same-bits STEPS SCENE.toml...
#include <array>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string_view>

#include "telenano/common/link/step_log.h"
#include "telenano/nve_server/scene/scene.h"
#include "telenano/nve_server/slave/logged_step.h"
#include "telenano/nve_server/slave/nve_slave.h"
#include "telenano/nve_server/slave/state_fields.h"

namespace {

using namespace telenano;  // NOLINT(google-build-using-namespace): a program of one file

/// On the grid of logged steps, so that no rounding of this program's own is in it: down, along, up, and the
/// next one beside it; ticks of many lengths, a let-go hand and a stop now and then.
class Motion {
 public:
  explicit Motion(const scene::Scene& scene) {
    const Vec3 start = scene.start_apex_w_nm;
    const double beside = scene.particle ? -30 : 0;
    const double x = scene.particle ? scene.particle->x_nm : start.x();
    const double y = scene.particle ? scene.particle->y_nm : start.y();
    start_ = link::logged_step({x + beside, y, start.z()}, 0, 1e-3).target;
    low_ = link::logged_step({0, 0, scene.start_touch_w_nm - (scene.marks ? 8 : 3)}, 0, 1e-3).target[2];
    if (scene.particle) low_ = link::logged_step({0, 0, scene.start_touch_w_nm + 4}, 0, 1e-3).target[2];
  }
  link::LoggedStep step(std::uint64_t number) const {
    constexpr std::int64_t kDown = 600, kAlong = 900, kRound = 2 * kDown + kAlong + 300;
    constexpr std::int64_t kCell = 16384;  // a nanometre
    const auto n = static_cast<std::int64_t>(number);
    const std::int64_t round = n / kRound, at = n % kRound;
    const std::int64_t down = at < kDown ? at : at < kDown + kAlong ? kDown : 2 * kDown + kAlong - at;
    const std::int64_t along = at < kDown ? 0 : at < kDown + kAlong ? at - kDown : kAlong;
    const std::int64_t deep = down < 0 ? 0 : down;
    link::LoggedStep step;
    step.target[0] = start_[0] + along * 60 * kCell / kAlong;
    step.target[1] = start_[1] + (round * 7 % 23 - 11) * kCell + along * (round % 5) * kCell / kAlong;
    step.target[2] = start_[2] + (low_ - start_[2]) * deep / kDown + (n * 7919 % 41) * kCell / 400;
    step.dt_ns =
        static_cast<std::uint32_t>(1'000'000 + (n * 104729 % 13) * 20'000 - (n % 17 == 0 ? 700'000 : 0));
    step.flags = link::kFlagClutch | link::kFlagDeadman;
    if (at >= kRound - 40) step.flags = link::kFlagDeadman;  // lets go
    if (round % 9 == 4 && at > kDown && at < kDown + 30) step.flags = link::kFlagStop;
    return step;
  }

 private:
  std::array<std::int64_t, 3> start_{};
  std::int64_t low_ = 0;
};

void run(const char* path, std::uint64_t steps) {
  const auto scene = scene::load_scene(path);
  slave::NveSlave slave(scene);
  const Motion motion(*scene);
  slave::SlaveOutput output;
  std::uint64_t all = 0, touching = 0;
  double work_aj = 0;
  Vec3 last_w_nm = scene->start_apex_w_nm;
  for (std::uint64_t number = 1; number <= steps; ++number) {
    const link::LoggedStep step = motion.step(number);
    const Vec3 target_w_nm = link::target_w_nm(step);
    const bool was_up = (output.fault_bits & link::kFaultRetracted) != 0;
    slave.step(
        slave::input_of(target_w_nm, (target_w_nm - last_w_nm) / link::dt_s(step), step.flags, true, was_up),
        link::dt_s(step), output);
    last_w_nm = target_w_nm;
    all = slave::mix_words(all + 1, slave.state_hash());
    touching += output.contact_state == link::ContactState::kContact;
    work_aj = output.energy_in_aj;
  }
  std::printf("%s: %llu steps, %llu of them touching, %.17g aJ put in, states %016llx\n", scene->name.c_str(),
              static_cast<unsigned long long>(steps), static_cast<unsigned long long>(touching), work_aj,
              static_cast<unsigned long long>(all));
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 2 && std::string_view(argv[1]) == "--compiler") {
#ifdef __clang__
    std::puts("clang " __clang_version__);
#else
    std::puts("gcc " __VERSION__);
#endif
    return 0;
  }
  const std::uint64_t steps = argc > 2 ? std::strtoull(argv[1], nullptr, 10) : 0;
  if (steps == 0) {
    std::fprintf(stderr, "usage: telenano-same-bits STEPS SCENE.toml...\n");
    return 2;
  }
  try {
    for (int i = 2; i < argc; ++i) run(argv[i], steps);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
  return 0;
}

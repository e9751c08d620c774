// Stands in for the vendor's libdrd in tests: same symbols, same signatures, loaded in the same way. It does
// what its script in shared memory says, and has a watchdog of its own like the device's.
#include <fcntl.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstdlib>
#include <thread>

#include "tests/support/standin_drd/standin_state.h"

using telenano::support::DrdCall;
using telenano::support::StandinState;

namespace {

std::int64_t now_ns() {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return std::int64_t{1'000'000'000} * now.tv_sec + now.tv_nsec;
}

StandinState& state() {
  static StandinState* const mapped = [] {
    const char* const path = std::getenv(telenano::support::kStandinVariable);
    const int fd = path != nullptr ? ::open(path, O_RDWR) : -1;
    void* const memory =
        fd >= 0 ? ::mmap(nullptr, sizeof(StandinState), PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0)
                : MAP_FAILED;
    if (fd >= 0) ::close(fd);
    if (memory == MAP_FAILED) std::abort();
    return static_cast<StandinState*>(memory);
  }();
  return *mapped;
}

void set_force(double x, double y, double z) {
  state().force_n[0] = x;
  state().force_n[1] = y;
  state().force_n[2] = z;
}

/// The device's electronics: no command for the watchdog's time, no force.
void watch(const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    std::this_thread::sleep_for(std::chrono::microseconds(250));
    StandinState& s = state();
    const std::int64_t allowed_ns = std::int64_t{125'000} * s.watchdog_units;
    if (allowed_ns == 0 || s.watchdog_fired_ns != 0 || now_ns() - s.last_force_ns < allowed_ns) continue;
    set_force(0, 0, 0);
    s.watchdog_fired_ns = now_ns();
    s.force_off_cause = 3;
  }
}

std::jthread g_watchdog;

/// The handle of a device that moves: m v̇ = F − b v − f_c sgn v − k (x − x₀) in steps of 5 µs of the wall's
/// time, to now, under the force that was shown since the last call. Positions as an encoder of 10 µm.
class Handle {
 public:
  void follow() {
    StandinState& s = state();
    const double mass_kg = s.mass_kg;
    if (mass_kg == 0) return;
    const std::int64_t now = now_ns();
    if (at_ns_ == 0) {
      at_ns_ = now;
      for (int axis = 0; axis < 3; ++axis) pos_m_[axis] = start_m_[axis] = s.pos_d_m[axis];
    }
    constexpr std::int64_t kStep_ns = 5'000;
    constexpr double kStep_s = 1e-9 * kStep_ns;
    for (; at_ns_ + kStep_ns <= now; at_ns_ += kStep_ns) {
      for (int axis = 0; axis < 3; ++axis) {
        double& v = vel_m_s_[axis];
        const double drive = s.force_n[axis] - s.held_n_m * (pos_m_[axis] - start_m_[axis]);
        // The friction first brakes, then holds.
        v += kStep_s * (drive - s.damping_n_s_m * v) / mass_kg;
        const double brake = kStep_s * s.friction_n / mass_kg;
        v = std::fabs(v) <= brake ? 0 : v - std::copysign(brake, v);
        pos_m_[axis] += kStep_s * v;
      }
    }
    constexpr double kEncoder_m = 1e-5;
    for (int axis = 0; axis < 3; ++axis) s.pos_d_m[axis] = kEncoder_m * std::round(pos_m_[axis] / kEncoder_m);
  }

 private:
  std::int64_t at_ns_ = 0;
  double pos_m_[3]{};
  double start_m_[3]{};
  double vel_m_s_[3]{};
};

Handle g_handle;

/// Counts, stalls; true when the script says what to return.
bool scripted(DrdCall call, int& result) {
  StandinState& s = state();
  ++s.calls_of(call);
  const int stall_us = s.stall_of(call).exchange(0);
  if (stall_us > 0) std::this_thread::sleep_for(std::chrono::microseconds(stall_us));
  if (s.unplugged != 0) {
    result = -1;
    return true;
  }
  result = s.result_of(call);
  return result != 0;
}

int open_device(char id) {
  int result = 0;
  if (scripted(DrdCall::kOpen, result)) return result;
  if (id < 0) id = 0;
  if (id >= state().devices) return -1;
  if (++state().open == 1) {
    state().last_force_ns = now_ns();
    g_watchdog = std::jthread(watch);
  }
  return id;
}

int close_device() {
  if (state().open > 0 && --state().open == 0) {
    g_watchdog.request_stop();
    g_watchdog.join();
    state().watchdog_units = 0;
  }
  return 0;
}

}  // namespace

#pragma GCC visibility push(default)
extern "C" {

int dhdGetDeviceCount() {
  return state().unplugged != 0 ? 0 : state().devices.load();
}
int dhdOpenID(char id) {
  return open_device(id);
}
int dhdOpen() {
  return open_device(0);
}
int dhdClose(char) {
  return close_device();
}
int dhdStop(char) {
  set_force(0, 0, 0);
  state().stopped = 1;
  return 0;
}
int dhdGetSystemType(char) {
  return 33;
}
const char* dhdGetSystemName(char) {
  return "omega.3";
}
int dhdGetSerialNumber(unsigned short* serial, char id) {
  *serial = static_cast<unsigned short>(state().serial + (id > 0 ? id : 0));
  return 0;
}
void dhdGetSDKVersion(int* major, int* minor, int* release, int* revision) {
  *major = 3;
  *minor = 17;
  *release = 6;
  *revision = 0;
}
int dhdGetPosition(double* x, double* y, double* z, char) {
  int result = 0;
  if (scripted(DrdCall::kGetPosition, result)) return result;
  g_handle.follow();
  *x = state().pos_d_m[0];
  *y = state().pos_d_m[1];
  *z = state().pos_d_m[2];
  return state().time_guard != 0 ? 1 : 0;
}
int dhdSetForce(double x, double y, double z, char) {
  int result = 0;
  if (scripted(DrdCall::kSetForce, result)) return result;
  g_handle.follow();
  StandinState& s = state();
  double norm_n = std::sqrt(x * x + y * y + z * z);
  if (s.first_force_n < 0) s.first_force_n = norm_n;
  s.last_force_ns = now_ns();
  const double most_n = s.saturation_n;
  const bool saturated = most_n > 0 && norm_n > most_n;
  const double factor = s.force_off_cause != 0 ? 0 : saturated ? most_n / norm_n : 1;
  set_force(factor * x, factor * y, factor * z);
  return saturated ? 2 : 0;
}
int dhdGetForce(double* x, double* y, double* z, char) {
  int result = 0;
  if (scripted(DrdCall::kGetForce, result)) return result;
  const auto& said = state().lie_about_force != 0 ? state().reported_force_n : state().force_n;
  *x = said[0];
  *y = said[1];
  *z = said[2];
  return 0;
}
int dhdConfigLinearVelocity(int, int, char) {
  return 0;
}
int dhdGetLinearVelocity(double* x, double* y, double* z, char) {
  *x = *y = *z = 0;
  return 0;
}
int dhdEnableForce(unsigned char on, char) {
  state().force_enabled = on;
  return 0;
}
int dhdSetGravityCompensation(int on, char) {
  if (state().refuse_gravity != 0) return -1;
  state().gravity = on;
  return 0;
}
int dhdSetBrakes(int, char) {
  return 0;
}
int dhdSetMaxForce(double force_n, char) {
  state().force_max_n = force_n;
  return 0;
}
double dhdGetMaxForce(char) {
  return state().force_max_n;
}
int dhdGetButton(int index, char) {
  return static_cast<int>(state().buttons >> index) & 1;
}
unsigned int dhdGetButtonMask(char) {
  int result = 0;
  if (scripted(DrdCall::kGetButtonMask, result)) return static_cast<unsigned>(result);
  return state().buttons;
}
int dhdGetStatus(int status[17], char) {
  int result = 0;
  if (scripted(DrdCall::kGetStatus, result)) return result;
  for (int i = 0; i < 17; ++i) status[i] = 0;
  StandinState& s = state();
  status[0] = s.power;
  status[1] = status[2] = 1;
  status[3] = s.calibrated;
  status[5] = s.force_enabled != 0 && s.force_off_cause == 0 ? 1 : 0;
  status[9] = s.error;
  status[10] = s.gravity;
  status[14] = s.force_off_cause;
  return 0;
}
double dhdGetComFreq(char) {
  return 4;
}
double dhdGetTime() {
  return 1e-9 * static_cast<double>(now_ns());
}
int dhdErrorGetLast() {
  return 1;
}
const char* dhdErrorGetLastStr() {
  return "scripted error";
}
int dhdSetTimeGuard(int, char) {
  return 0;
}
int dhdSetWatchdog(unsigned char units, char) {
  if (state().refuse_watchdog != 0) return -1;
  state().last_force_ns = now_ns();
  state().watchdog_units = units;
  return 0;
}

#ifndef TELENANO_STANDIN_WITHOUT_DRD
int drdOpenID(char id) {
  return open_device(id);
}
int drdClose(char) {
  return close_device();
}
bool drdIsInitialized(char) {
  return state().calibrated != 0;
}
int drdAutoInit(char) {
  if (state().refuse_auto_init != 0) return -1;
  ++state().auto_inits;
  state().calibrated = 1;
  return 0;
}
int drdStop(bool, char) {
  return 0;
}
#endif

}  // extern "C"
#pragma GCC visibility pop

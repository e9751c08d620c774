#pragma once
// The device of example 05: positions from standard input, forces to standard output.
#include <fcntl.h>
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>

#include "telenano/master/device/haptic_device.h"

namespace example {

using namespace telenano;

class PipeDevice final : public device::HapticDevice {
 public:
  PipeDevice() {
    info_.name = "pipe";
    info_.force_max_n = 12;
    info_.position_quantum_m = 1e-6;
    info_.damping_n_s_m = 1;  // of whoever moves the hand: what is promised of energy leans on it
    info_.mass_kg = 0.1;
    info_.workspace_radius_m = 0.1;
    info_.moves_by_itself = false;  // by advance()
    fcntl(STDIN_FILENO, F_SETFL, fcntl(STDIN_FILENO, F_GETFL) | O_NONBLOCK);
  }
  const device::DeviceInfo& info() const noexcept override { return info_; }
  bool ended() const noexcept { return ended_; }

  /// The hand goes to the newest position at 0.3 m/s at most: a script that was late, and writes ten lines at
  /// once, must not look like a hand that flies, which stops the station.
  void advance(std::int64_t dt_ns) noexcept override {
    const Vec3 way = goal_h_m_ - pos_h_m_;
    const double most = 0.3e-9 * static_cast<double>(dt_ns);
    pos_h_m_ += way.norm() > most ? Vec3(most / way.norm() * way) : way;
  }

  // Neither waits nor allocates: the newest whole line that is there counts.
  void read(device::DeviceReading& reading) noexcept override {
    for (ssize_t n = 0; (n = ::read(STDIN_FILENO, line_ + used_, sizeof line_ - 1 - used_)) >= 0;) {
      if (n == 0) {
        ended_ = true;
        break;
      }
      used_ += static_cast<std::size_t>(n);
      line_[used_] = 0;
      std::size_t begin = 0;
      for (std::size_t i = 0; i < used_; ++i) {
        if (line_[i] != '\n') continue;
        double x = 0, y = 0, z = 0;
        if (std::sscanf(line_ + begin, "%lf %lf %lf", &x, &y, &z) == 3) goal_h_m_ = 1e-3 * Vec3(x, y, z);
        begin = i + 1;
      }
      if (begin == 0 && used_ == sizeof line_ - 1) begin = used_;  // no line is as long
      std::copy(line_ + begin, line_ + used_, line_);
      used_ -= begin;
    }
    reading.status = device::DeviceStatus::kOk;
    reading.hand_pos_h_m = pos_h_m_;
    reading.buttons = device::kButtonDeadman;
  }
  Vec3 write_force(const Vec3& force_h_n) noexcept override {
    const Vec3 applied = force_h_n.cwiseMax(-info_.force_max_n).cwiseMin(info_.force_max_n);
    pollfd out{STDOUT_FILENO, POLLOUT, 0};
    if ((applied - told_h_n_).norm() > 1e-3 && ::poll(&out, 1, 0) == 1 && (out.revents & POLLOUT) != 0) {
      char text[96];
      const int n =
          std::snprintf(text, sizeof text, "%.4f %.4f %.4f\n", applied.x(), applied.y(), applied.z());
      if (::write(STDOUT_FILENO, text, static_cast<std::size_t>(n)) == n) told_h_n_ = applied;
    }
    return applied;  // what the energy account counts
  }

 private:
  device::DeviceInfo info_;
  Vec3 pos_h_m_ = Vec3::Zero();
  Vec3 goal_h_m_ = Vec3::Zero();
  Vec3 told_h_n_ = Vec3::Zero();
  char line_[256] = {};
  std::size_t used_ = 0;
  bool ended_ = false;
};

}  // namespace example

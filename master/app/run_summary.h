#pragma once

#include <cstdint>
#include <string>

#include "common/link/client_session.h"
#include "common/recording/recorder.h"
#include "common/recording/sample.h"
#include "common/rt/log_histogram.h"
#include "common/rt/periodic_timer.h"

namespace telenano::app {

/// What a session was like, gathered tick by tick without allocating, printed at the end for a person.
class RunSummary {
 public:
  explicit RunSummary(double rate_hz) : rate_hz_(rate_hz) {}

  void add(const recording::Sample& sample) noexcept;
  /// `recorder` may be null.
  void print(const rt::PeriodicTimerStats& timer, const link::ClientSession& session,
             const recording::Recorder* recorder, const std::string& recording_path) const;

 private:
  double rate_hz_;
  std::int64_t ticks_ = 0;
  std::int64_t contact_ticks_ = 0;
  std::int64_t controlled_ticks_ = 0;
  double pull_off_nn_ = 0;
  double push_nn_ = 0;
  double lowest_tip_nm_ = 1e300;
  double surface_touch_nm_ = 0;
  bool touched_ = false;
  double hand_force_n_ = 0;
  recording::Sample last_;
  std::int64_t last_reply_ = 0;
  rt::LogHistogram rtt_;
  rt::LogHistogram step_;
};

}  // namespace telenano::app

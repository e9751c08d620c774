#include "telenano/common/rt/realtime_thread.h"

#include <gtest/gtest.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>

#include <atomic>
#include <thread>

namespace telenano::rt {
namespace {

/// Whatever this machine permits, the report says what the kernel says.
TEST(RealtimeThread, ReportsWhatItReallyGot) {
  std::atomic<int> policy{-1};
  std::atomic<int> slack{-1};
  std::atomic<bool> stopped{false};
  {
    RealtimeThread thread({.priority = 10, .cpu = 0, .lock_memory = true}, [&](std::stop_token stop) {
      sched_param param{};
      int now = -1;
      ::pthread_getschedparam(::pthread_self(), &now, &param);
      policy = now;
      slack = ::prctl(PR_GET_TIMERSLACK, 0, 0, 0, 0);
      while (!stop.stop_requested()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
      stopped = true;
    });
    const RealtimeReport& report = thread.report();
    while (slack < 0) std::this_thread::yield();
    EXPECT_EQ(report.fifo, policy == SCHED_FIFO);
    if (report.timer_slack && !report.fifo) {
      EXPECT_EQ(slack, 1);
    }
    EXPECT_FALSE(report.text.empty());
    EXPECT_EQ(report.advice.empty(), report.fifo && report.memory_locked && report.pinned) << report.advice;
  }
  EXPECT_TRUE(stopped) << "the destructor asks to stop and waits";
  ::munlockall();
}

TEST(RealtimeThread, AWishThatCannotBeGrantedIsAdviceNotAnError) {
  RealtimeThread thread({.priority = 0, .cpu = 100'000, .lock_memory = false}, [](std::stop_token) {});
  EXPECT_FALSE(thread.report().pinned);
  EXPECT_NE(thread.report().advice.find("processor 100000"), std::string::npos) << thread.report().advice;
  EXPECT_NE(thread.report().text.find("ordinary scheduling"), std::string::npos);
}

}  // namespace
}  // namespace telenano::rt

#pragma once

#include <atomic>
#include <thread>
#include <utility>
#include <vector>

namespace telenano::studies::stress {

/// Threads that end with this object: a relay's, or a loop on each core. They look at `stop`.
class EndingThreads {
 public:
  ~EndingThreads() {
    stop = true;
    for (std::thread& thread : threads_) thread.join();
  }
  template <class Work>
  void start(Work work) {
    threads_.emplace_back(std::move(work));
  }
  std::atomic<bool> stop{false};

 private:
  std::vector<std::thread> threads_;
};

}  // namespace telenano::studies::stress

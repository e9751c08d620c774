#pragma once

#include <condition_variable>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>

namespace telenano::app {

/// A thread that does what others give it. What is started gives way as its starter does (nice values are inherited):
/// one that was made before the picture became the program's background can still start what must not.
class EarlyThread {
 public:
  EarlyThread();
  ~EarlyThread();
  EarlyThread(const EarlyThread&) = delete;
  EarlyThread& operator=(const EarlyThread&) = delete;

  /// Comes back when it is done; what it throws is thrown. One at a time.
  void call(const std::function<void()>& work);

 private:
  void run();

  std::mutex mutex_;
  std::condition_variable changed_;
  const std::function<void()>* work_ = nullptr;
  std::exception_ptr failed_;
  bool ends_ = false;
  std::thread thread_;
};

}  // namespace telenano::app

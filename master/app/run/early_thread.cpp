#include "telenano/master/app/run/early_thread.h"

#include <exception>
#include <utility>

#include "telenano/common/rt/signals_blocked.h"

namespace telenano::app {

EarlyThread::EarlyThread() {
  const rt::SignalsBlocked blocked;  // signals are for the main thread
  thread_ = std::thread([this] { run(); });
}

EarlyThread::~EarlyThread() {
  {
    const std::lock_guard lock(mutex_);
    ends_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

void EarlyThread::call(const std::function<void()>& work) {
  std::unique_lock lock(mutex_);
  work_ = &work;
  changed_.notify_all();
  changed_.wait(lock, [this] { return work_ == nullptr; });
  if (failed_) std::rethrow_exception(std::exchange(failed_, nullptr));
}

void EarlyThread::run() {
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [this] { return ends_ || work_ != nullptr; });
    if (work_ == nullptr) return;
    lock.unlock();
    std::exception_ptr failed;
    try {
      (*work_)();
    } catch (...) {
      failed = std::current_exception();
    }
    lock.lock();
    failed_ = failed;
    work_ = nullptr;
    changed_.notify_all();
  }
}

}  // namespace telenano::app

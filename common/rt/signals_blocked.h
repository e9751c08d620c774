#pragma once

#include <csignal>

namespace telenano::rt {

/// Blocks all signals of the calling thread from here to the end of the scope. A thread that is made
/// meanwhile inherits the mask from its first instruction, so that signals which end a program reach its main
/// thread alone.
class SignalsBlocked {
 public:
  SignalsBlocked() noexcept {
    sigset_t all;
    ::sigfillset(&all);
    ::pthread_sigmask(SIG_SETMASK, &all, &before_);
  }
  ~SignalsBlocked() { ::pthread_sigmask(SIG_SETMASK, &before_, nullptr); }
  SignalsBlocked(const SignalsBlocked&) = delete;
  SignalsBlocked& operator=(const SignalsBlocked&) = delete;

 private:
  sigset_t before_{};
};

}  // namespace telenano::rt

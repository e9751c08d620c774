#pragma once

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cstdlib>
#include <new>
#include <stdexcept>
#include <string>

#include "tests/support/standin_drd/standin_state.h"

namespace telenano::support {

/// The test's side of the stand-in: its script, in the state that a fresh device has. This process and the
/// programs that it starts afterwards find it. One at a time.
class StandinSdk {
 public:
  StandinSdk() : state_(new (mapping()) StandinState) {}
  ~StandinSdk() = default;
  StandinSdk(const StandinSdk&) = delete;
  StandinSdk& operator=(const StandinSdk&) = delete;

  StandinState* operator->() { return state_; }
  StandinState& operator*() { return *state_; }
  double force_n() const {
    double sum = 0;
    for (const auto& part : state_->force_n) sum += part < 0 ? -part : part.load();
    return sum;
  }

 private:
  // One file for the life of the process: the library maps it once.
  static void* mapping() {
    static void* const memory = [] {
      const std::string path = "/tmp/telenano_standin_" + std::to_string(::getpid());
      const int fd = ::open(path.c_str(), O_RDWR | O_CREAT | O_TRUNC, 0600);
      if (fd < 0 || ::ftruncate(fd, sizeof(StandinState)) != 0)
        throw std::runtime_error("cannot create " + path);
      void* const mapped = ::mmap(nullptr, sizeof(StandinState), PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
      ::close(fd);
      if (mapped == MAP_FAILED) throw std::runtime_error("cannot map " + path);
      ::setenv(kStandinVariable, path.c_str(), 1);
      static const struct Remover {
        std::string path;
        ~Remover() { ::unlink(path.c_str()); }
      } remover{path};
      return mapped;
    }();
    return memory;
  }

  StandinState* state_;
};

}  // namespace telenano::support

#pragma once

// For libFuzzer programs (TELENANO_FUZZ) only: clang, inline 8-bit counters, AddressSanitizer.

#include <dlfcn.h>
#include <execinfo.h>
#include <sanitizer/asan_interface.h>
#include <signal.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "fuzz_input.h"
#include "telenano/common/base/error.h"
#include "telenano/common/recording/child_call.h"

namespace telenano::fuzz {

/// What -fsanitize=fuzzer-no-link counts in, all of this program.
std::span<std::uint8_t> coverage_counters() noexcept;

/// A function that may bring down a library which is not ours, in a process beside: its coverage is carried
/// over to this one, so that the fuzzer sees where the input led. One process serves kCalls inputs, or until
/// it ends.
///
/// Where it ends is told by its stack. With a frame of the library in it, that is the library's own (or
/// memory or time that it asked for without end); else the input is a finding, and this process ends too.
class GuidedReading {
 public:
  using Read = std::function<void(std::string_view request)>;

  GuidedReading(const char* library, Read read) : read_(std::move(read)) {
    void* memory = ::mmap(nullptr, sizeof(Shared) + coverage_bytes(), PROT_READ | PROT_WRITE,
                          MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    FUZZ_CHECK(memory != MAP_FAILED);
    shared_ = static_cast<Shared*>(memory);
    std::snprintf(shared_->library, sizeof shared_->library, "%s", library);
  }

  /// False where the library brought its process down.
  bool goes_well(std::string_view request) {
    if (!child_ || ++calls_ > kCalls) {
      calls_ = 0;
      child_.reset();
      child_ = std::make_unique<recording::ChildCall>(
          "reading", [this](std::string_view asked) { return serve(asked); }, std::chrono::seconds(60));
    }
    shared_->end = End::kNone;
    std::uint8_t* theirs = coverage();
    std::memset(theirs, 0, coverage_bytes());
    bool well = true;
    try {
      child_->ask(request);
    } catch (const RunError& error) {
      well = false;
      child_.reset();
      if (shared_->end == End::kOurs) {
        std::fprintf(stderr, "the process beside ended in our own code; what it said stands above\n");
        std::abort();
      }
    }
    for (std::size_t i = 0; i < coverage_bytes(); ++i) {
      std::uint8_t& mine = coverage_counters()[i];
      mine = static_cast<std::uint8_t>(std::min(mine + theirs[i], 255));
    }
    return well;
  }

 private:
  static constexpr int kCalls = 256;  // and then a library that is not quite well goes

  enum class End : std::uint8_t { kNone, kLibrary, kOurs };
  struct Shared {
    End end;
    char library[31];
  };
  static std::size_t coverage_bytes() { return coverage_counters().size(); }
  std::uint8_t* coverage() const { return reinterpret_cast<std::uint8_t*>(shared_ + 1); }

  std::string serve(std::string_view request) {
    if (here_ == nullptr) {
      here_ = shared_;
      __sanitizer_set_death_callback([] { end(); });
      struct sigaction action {};
      action.sa_handler = [](int) { end(); };
      for (const int number : {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT, SIGXCPU})
        ::sigaction(number, &action, nullptr);
    }
    std::memset(coverage_counters().data(), 0, coverage_bytes());
    read_(request);
    std::memcpy(coverage(), coverage_counters().data(), coverage_bytes());
    return {};
  }

  /// In the process beside, when it ends.
  [[noreturn]] static void end() {
    std::memcpy(here_ + 1, coverage_counters().data(), coverage_bytes());
    std::array<void*, 128> frames{};
    const int n = ::backtrace(frames.data(), static_cast<int>(frames.size()));
    here_->end = whose(frames.data(), n);
    if (here_->end == End::kOurs) ::backtrace_symbols_fd(frames.data(), n, STDERR_FILENO);
    ::_exit(1);
  }

  static End whose(void* const* frames, int n) {
    if (__asan_report_present() != 0) {
      // A size beyond all memory is bad_alloc without the sanitizer.
      const std::string_view what = __asan_get_report_description();
      if (what == "allocation-size-too-big" || what == "out-of-memory") return End::kLibrary;
      // A buffer of ours that the library was told to fill and that is too small for it is ours; what it does
      // to its own memory is not. The first frame below malloc says whose.
      std::array<char, 64> name{};
      void* region = nullptr;
      std::size_t region_size = 0;
      void* const address = __asan_get_report_address();
      const std::string_view where =
          __asan_locate_address(address, name.data(), name.size(), &region, &region_size);
      if (where == "stack" || where == "global") return End::kOurs;
      if (where == "heap") {
        std::array<void*, 2> allocated{};
        int thread = 0;
        const std::size_t known =
            __asan_get_alloc_stack(address, allocated.data(), allocated.size(), &thread);
        return in_library(allocated.data(), static_cast<int>(known)) ? End::kLibrary : End::kOurs;
      }
    }
    return in_library(frames, n) ? End::kLibrary : End::kOurs;
  }

  static bool in_library(void* const* frames, int n) {
    for (int i = 0; i < n; ++i) {
      Dl_info info{};
      if (::dladdr(frames[i], &info) != 0 && info.dli_fname != nullptr &&
          std::strstr(info.dli_fname, here_->library) != nullptr)
        return true;
    }
    return false;
  }

  static inline Shared* here_ = nullptr;  // set in the process beside
  Read read_;
  Shared* shared_ = nullptr;
  std::unique_ptr<recording::ChildCall> child_;
  int calls_ = 0;
};

}  // namespace telenano::fuzz

// What the library asks for without end is refused, as the kernel would in the end; freed memory is kept for
// a while only, lest each fork copy the tables of much of it.
extern "C" inline const char* __asan_default_options() {
  return "max_allocation_size_mb=1024:allocator_may_return_null=1:quarantine_size_mb=16";
}

#pragma once

#include <cstdint>

namespace telenano::support {

/// Counts what the calling thread takes from the heap while the guard lives: operator new, malloc, calloc,
/// realloc and the aligned forms, whoever calls them. Frees are counted apart. Linking telenano_support_alloc
/// replaces malloc in the whole program; under a sanitizer, which has its own malloc, nothing is counted and
/// active() is false.
///
///   const AllocGuard guard;
///   station.step(...);
///   EXPECT_EQ(guard.allocations(), 0u);
class AllocGuard {
 public:
  AllocGuard() noexcept;
  std::uint64_t allocations() const noexcept;
  std::uint64_t frees() const noexcept;
  /// False where counting is not possible; a test of zero allocations then proves nothing and should say so.
  static bool active() noexcept;

 private:
  std::uint64_t allocations_at_start_;
  std::uint64_t frees_at_start_;
};

}  // namespace telenano::support

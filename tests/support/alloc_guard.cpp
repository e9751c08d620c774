#include "tests/support/alloc_guard.h"

#include <cerrno>
#include <cstddef>

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__) || !defined(__GLIBC__)
#define TELENANO_COUNTS_ALLOCATIONS 0
#else
#define TELENANO_COUNTS_ALLOCATIONS 1
#endif

namespace {

// In the program itself, not in a shared library, so the compiler needs no allocation to reach them.
thread_local std::uint64_t allocations = 0;
thread_local std::uint64_t frees = 0;

}  // namespace

#if TELENANO_COUNTS_ALLOCATIONS

// glibc's own entry points under the names that stay when malloc is replaced. The C++ operators call malloc,
// so replacing these few counts everything.
extern "C" {

void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* old, std::size_t size);
void* __libc_memalign(std::size_t alignment, std::size_t size);
void __libc_free(void* memory);

void* malloc(std::size_t size) {
  ++allocations;
  return __libc_malloc(size);
}

void* calloc(std::size_t count, std::size_t size) {
  ++allocations;
  return __libc_calloc(count, size);
}

void* realloc(void* old, std::size_t size) {
  ++allocations;
  return __libc_realloc(old, size);
}

void* memalign(std::size_t alignment, std::size_t size) {
  ++allocations;
  return __libc_memalign(alignment, size);
}

void* aligned_alloc(std::size_t alignment, std::size_t size) {
  ++allocations;
  return __libc_memalign(alignment, size);
}

int posix_memalign(void** memory, std::size_t alignment, std::size_t size) {
  ++allocations;
  void* taken = __libc_memalign(alignment, size);
  if (taken == nullptr) return ENOMEM;
  *memory = taken;
  return 0;
}

void free(void* memory) {
  if (memory != nullptr) ++frees;
  __libc_free(memory);
}

}  // extern "C"

#endif

namespace telenano::support {

AllocGuard::AllocGuard() noexcept : allocations_at_start_(::allocations), frees_at_start_(::frees) {}

std::uint64_t AllocGuard::allocations() const noexcept {
  return ::allocations - allocations_at_start_;
}

std::uint64_t AllocGuard::frees() const noexcept {
  return ::frees - frees_at_start_;
}

bool AllocGuard::active() noexcept {
  return TELENANO_COUNTS_ALLOCATIONS != 0;
}

}  // namespace telenano::support

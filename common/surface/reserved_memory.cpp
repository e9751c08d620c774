#include "telenano/common/surface/reserved_memory.h"

#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <new>

namespace telenano::surface {
namespace {

std::size_t page_bytes() noexcept {
  static const auto bytes = static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
  return bytes;
}

}  // namespace

// Without rights: such pages are neither counted as promised nor filled by mlockall().
ReservedMemory::ReservedMemory(std::size_t doubles) : count_(doubles) {
  bytes_ =
      (std::max<std::size_t>(1, doubles) * sizeof(double) + page_bytes() - 1) / page_bytes() * page_bytes();
  void* const at = ::mmap(nullptr, bytes_, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (at == MAP_FAILED) throw std::bad_alloc();
  first_ = static_cast<double*>(at);
}

ReservedMemory::~ReservedMemory() {
  ::munmap(first_, bytes_);
}

ReservedMemory::Pages ReservedMemory::pages(std::size_t first, std::size_t count) const noexcept {
  const std::size_t from = first * sizeof(double) / page_bytes() * page_bytes();
  const std::size_t to =
      std::min(bytes_, (first + count) * sizeof(double) + page_bytes() - 1) / page_bytes() * page_bytes();
  return {reinterpret_cast<char*>(first_) + from, to > from ? to - from : 0};
}

bool ReservedMemory::open(std::size_t first, std::size_t count) const noexcept {
  const Pages to_open = pages(first, count);
  return to_open.bytes == 0 || ::mprotect(to_open.at, to_open.bytes, PROT_READ | PROT_WRITE) == 0;
}

// The system fills locked memory as soon as it may be written.
bool ReservedMemory::open_unlocked(std::size_t first, std::size_t count) const noexcept {
  const Pages to_open = pages(first, count);
  return to_open.bytes == 0 || (::munlock(to_open.at, to_open.bytes) == 0 &&
                                ::mprotect(to_open.at, to_open.bytes, PROT_READ | PROT_WRITE) == 0);
}

}  // namespace telenano::surface

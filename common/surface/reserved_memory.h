#pragma once

#include <cstddef>

namespace telenano::surface {

/// Addresses for many doubles, of which only those take memory that have been opened: for a large array that
/// is filled here and there. What is not open must not be read. A process that locks its memory locks what is
/// open.
class ReservedMemory {
 public:
  /// Throws std::bad_alloc where the addresses are not to be had.
  explicit ReservedMemory(std::size_t doubles);
  ~ReservedMemory();
  ReservedMemory(const ReservedMemory&) = delete;
  ReservedMemory& operator=(const ReservedMemory&) = delete;

  double* data() const noexcept { return first_; }
  std::size_t size() const noexcept { return count_; }
  /// From `first` on, and what shares pages with them: 0 at first. Any thread; again is harmless. False where
  /// the system has no memory.
  bool open(std::size_t first, std::size_t count) const noexcept;
  /// The same for more than what will be written: though the process locks its memory, each page takes some
  /// only when it is first written, and is not locked.
  bool open_unlocked(std::size_t first, std::size_t count) const noexcept;

 private:
  struct Pages {
    void* at;
    std::size_t bytes;
  };
  Pages pages(std::size_t first, std::size_t count) const noexcept;

  double* first_ = nullptr;
  std::size_t count_;
  std::size_t bytes_;
};

}  // namespace telenano::surface

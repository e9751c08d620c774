#pragma once

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

namespace telenano::slave {

/// Little-endian bytes, 8 for a double, 1 for a bool, 4 for an int. `ok` is false when they did not fit.
class StateWriter {
 public:
  static constexpr bool kReads = false;
  explicit StateWriter(std::span<std::uint8_t> out) noexcept : out_(out) {}
  void operator()(const double& x) noexcept { put(&x, sizeof x); }
  void operator()(const bool& x) noexcept {
    const std::uint8_t byte = x ? 1 : 0;
    put(&byte, 1);
  }
  void operator()(const int& x) noexcept { put(&x, sizeof x); }
  void operator()(const std::uint64_t& x) noexcept { put(&x, sizeof x); }
  bool ok() const noexcept { return ok_; }
  std::size_t size() const noexcept { return at_; }

 private:
  void put(const void* from, std::size_t bytes) noexcept {
    if (!ok_ || out_.size() - at_ < bytes) {
      ok_ = false;
      return;
    }
    std::memcpy(out_.data() + at_, from, bytes);
    at_ += bytes;
  }
  std::span<std::uint8_t> out_;
  std::size_t at_ = 0;
  bool ok_ = true;
};

/// Of bytes that may be anybody's: what is cut, not finite or no value of its kind makes `ok` false.
class StateReader {
 public:
  static constexpr bool kReads = true;
  explicit StateReader(std::span<const std::uint8_t> in) noexcept : in_(in) {}
  void operator()(double& x) noexcept {
    take(&x, sizeof x);
    if (!std::isfinite(x)) fail();
    if (!ok_) x = 0;
  }
  void operator()(bool& x) noexcept {
    std::uint8_t byte = 0;
    take(&byte, 1);
    if (byte > 1) fail();
    x = byte == 1;
  }
  void operator()(int& x) noexcept { take(&x, sizeof x); }
  void operator()(std::uint64_t& x) noexcept { take(&x, sizeof x); }
  void fail() noexcept { ok_ = false; }
  bool ok() const noexcept { return ok_; }
  bool at_end() const noexcept { return at_ == in_.size(); }
  std::size_t at() const noexcept { return at_; }

 private:
  void take(void* to, std::size_t bytes) noexcept {
    if (!ok_ || in_.size() - at_ < bytes) {
      ok_ = false;
      std::memset(to, 0, bytes);
      return;
    }
    std::memcpy(to, in_.data() + at_, bytes);
    at_ += bytes;
  }
  std::span<const std::uint8_t> in_;
  std::size_t at_ = 0;
  bool ok_ = true;
};

static_assert(std::endian::native == std::endian::little, "values go as they are");

}  // namespace telenano::slave

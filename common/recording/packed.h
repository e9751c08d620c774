#pragma once

// Only for the files of this folder.

#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <type_traits>

#include "telenano/common/base/error.h"

namespace telenano::recording {

/// Plain values one after the other, between two processes of one program.
class Packer {
 public:
  template <class T>
  Packer& put(const T& value) {
    static_assert(std::is_trivially_copyable_v<T>);
    return raw(&value, sizeof value);
  }
  Packer& text(std::string_view value) {
    return put(std::uint64_t{value.size()}).raw(value.data(), value.size());
  }
  Packer& raw(const void* data, std::size_t size) {
    bytes_.append(static_cast<const char*>(data), size);
    return *this;
  }
  std::string take() { return std::move(bytes_); }

 private:
  std::string bytes_;
};

/// Throws RunError when there is less than is asked for: the other process may be out of its mind.
class Unpacker {
 public:
  explicit Unpacker(std::string_view bytes) : left_(bytes) {}
  template <class T>
  T get() {
    static_assert(std::is_trivially_copyable_v<T>);
    T value;
    std::memcpy(static_cast<void*>(&value), raw(sizeof value).data(), sizeof value);
    return value;
  }
  std::string text() { return std::string(raw(get<std::uint64_t>())); }
  std::string_view raw(std::uint64_t size) {
    if (size > left_.size()) throw RunError("the process that reads a recording answers nonsense");
    const std::string_view taken = left_.substr(0, size);
    left_.remove_prefix(size);
    return taken;
  }
  std::size_t left() const noexcept { return left_.size(); }

 private:
  std::string_view left_;
};

}  // namespace telenano::recording

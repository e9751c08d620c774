#pragma once

#include <memory>
#include <type_traits>

namespace telenano {

/// `x = T{}` for states of some hundred bytes, in place. For the assignment gcc makes a temporary and copies it in words of another
/// size than it was written in, for which the processor waits.
template <class T>
inline void renew(T& x) noexcept {
  static_assert(std::is_trivially_destructible_v<T>);
  std::construct_at(&x);
}

}  // namespace telenano

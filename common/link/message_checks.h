#pragma once

#include "telenano/common/link/drop_cause.h"
#include "telenano/common/link/messages.h"

/// What the values of a message may be, beyond its form. Whether sequences rise and sessions exist is checked by the state
/// machines.
namespace telenano::link {

/// Sum of the differences x - x: 0 if every one is finite, NaN otherwise. One branch for the whole message.
template <class... Doubles>
bool all_finite(Doubles... values) noexcept {
  return ((values - values) + ... + 0.0) == 0.0;
}

inline bool all_finite(const Vec3& v) noexcept {
  return all_finite(v.x(), v.y(), v.z());
}

constexpr DropCause in_range(bool good) noexcept {
  return good ? DropCause::kNone : DropCause::kOutOfRange;
}

/// A value that is not finite is named before one that is out of range, wherever the two are (PROTOCOL.md, section 8).
inline DropCause first_cause(DropCause a, DropCause b) noexcept {
  return a == DropCause::kNone || b == DropCause::kNonFinite ? b : a;
}

DropCause check(const Hello& message) noexcept;
DropCause check(const Challenge& message) noexcept;
DropCause check(const Welcome& message) noexcept;
DropCause check(const Refuse& message) noexcept;
DropCause check(const Bye& message) noexcept;
DropCause check(const SceneRequest& message) noexcept;
DropCause check(const SceneChunk& message) noexcept;
DropCause check(const Command& message) noexcept;
DropCause check(const Reply& message) noexcept;

/// Of the fields behind feature bits; most messages have none whose range is checked.
template <class Message>
DropCause check_features(const Message&) noexcept {
  return DropCause::kNone;
}

DropCause check_features(const Command& message) noexcept;
DropCause check_features(const Reply& message) noexcept;

}  // namespace telenano::link

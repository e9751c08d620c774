#pragma once

#include <bit>
#include <cstdint>
#include <cstring>
#include <type_traits>

#include "proto/wire_fields.h"

/// A writer and a reader of the stream's messages in their usual form: fixed-width fields in rising order, zeros
/// left out, as proto3 writes them. It is the same form on the wire as Protobuf's (a test holds the two
/// together, bit by bit); but each value is moved once instead of three times (scan, parse, copy), which the
/// loops feel. Whatever comes in another form is Protobuf's business. Which fields there are is said by
/// telenano.proto, from which wire_fields.h is made: `visit_fields`, and `visit_feature_fields` for those behind
/// feature bits.
namespace telenano::link {

#define TELENANO_INLINED __attribute__((always_inline))
#define TELENANO_INLINE TELENANO_INLINED inline

/// A field's tag as it stands on the wire: number << 3 | wire type, seven bits a byte, the low ones first.
template <std::uint32_t kNumber, class Value>
struct FieldTag {
  static_assert(std::is_trivially_copyable_v<Value> && (sizeof(Value) == 4 || sizeof(Value) == 8));
  static constexpr std::uint32_t kTag = (kNumber << 3) | (sizeof(Value) == 4 ? 5u : 1u);
  static constexpr std::size_t kTagBytes = kTag < 0x80 ? 1 : 2;
  static_assert(kTag < 0x4000);
  static constexpr std::size_t kBytes = kTagBytes + sizeof(Value);
  static constexpr std::uint8_t kFirst =
      kTagBytes == 1 ? kTag : static_cast<std::uint8_t>((kTag & 0x7f) | 0x80);
  static constexpr std::uint8_t kSecond = static_cast<std::uint8_t>(kTag >> 7);

  static bool is_at(const std::uint8_t* at) noexcept {
    return at[0] == kFirst && (kTagBytes == 1 || at[1] == kSecond);
  }
};

// What a run of fields that are all there comes to. Its places are known when the program is compiled, so
// that no field waits for the one before it.

struct RunBytes {
  std::size_t bytes = 0;
  template <std::uint32_t kNumber, class Value>
  TELENANO_INLINE void operator()(const Value&) noexcept {
    bytes += FieldTag<kNumber, Value>::kBytes;
  }
};

struct RunTags {
  const std::uint8_t* at;
  bool all = true;
  template <std::uint32_t kNumber, class Value>
  TELENANO_INLINE void operator()(const Value&) noexcept {
    all = all && FieldTag<kNumber, Value>::is_at(at);
    at += FieldTag<kNumber, Value>::kBytes;
  }
};

struct RunValues {
  const std::uint8_t* at;
  template <std::uint32_t kNumber, class Value>
  TELENANO_INLINE void operator()(Value& value) noexcept {
    std::memcpy(&value, at + FieldTag<kNumber, Value>::kTagBytes, sizeof value);
    at += FieldTag<kNumber, Value>::kBytes;
  }
};

/// The bits of all fields, one over the other: 0 if none is to be written.
struct AnyBits {
  std::uint64_t bits = 0;
  template <std::uint32_t kNumber, class Value>
  TELENANO_INLINE void operator()(const Value& value) noexcept {
    using Bits = std::conditional_t<sizeof(Value) == 4, std::uint32_t, std::uint64_t>;
    bits |= std::bit_cast<Bits>(value);
  }
  template <class Body>
  TELENANO_INLINE void run(const Body& body) noexcept {
    body(*this);
  }
};

/// Whether every number is one: x - x is 0 for each that is finite, NaN otherwise. One branch for all; four
/// sums, so that no addition waits for the one before it.
struct AllFinite {
  double zero[4] = {};
  std::size_t next = 0;  // a constant, once the fields are inlined
  template <std::uint32_t kNumber, class Value>
  TELENANO_INLINE void operator()(const Value& value) noexcept {
    if constexpr (std::is_same_v<Value, double>) zero[next++ % 4] += value - value;
  }
  template <class Body>
  TELENANO_INLINE void run(const Body& body) noexcept {
    body(*this);
  }
  bool is() const noexcept { return (zero[0] + zero[1]) + (zero[2] + zero[3]) == 0; }
};

/// Sets fields to zero.
struct Clearing {
  template <std::uint32_t kNumber, class Value>
  TELENANO_INLINE void operator()(Value& value) noexcept {
    value = Value{};
  }
  template <class Body>
  TELENANO_INLINE void run(const Body& body) noexcept {
    body(*this);
  }
};

/// Writes fields to `at`, which needs room for all of them.
struct FlatWriter {
  std::uint8_t* at;

  template <std::uint32_t kNumber, class Value>
  TELENANO_INLINE void operator()(const Value& value) noexcept {
    using Tag = FieldTag<kNumber, Value>;
    using Bits = std::conditional_t<sizeof(Value) == 4, std::uint32_t, std::uint64_t>;
    const auto bits = std::bit_cast<Bits>(value);
    if (bits == 0) return;  // proto3: also where the value is zero; −0 is none
    at[0] = Tag::kFirst;
    if constexpr (Tag::kTagBytes == 2) at[1] = Tag::kSecond;
    std::memcpy(at + Tag::kTagBytes, &bits, sizeof bits);
    at += Tag::kBytes;
  }
  template <class Body>
  TELENANO_INLINE void run(const Body& body) noexcept {
    body(*this);
  }
};

/// Reads fields from `at` as long as they come in order; one that does not come is zero. What is left at the
/// end came in another form.
struct FlatReader {
  const std::uint8_t* at;
  const std::uint8_t* end;

  template <std::uint32_t kNumber, class Value>
  TELENANO_INLINE void operator()(Value& value) noexcept {
    using Tag = FieldTag<kNumber, Value>;
    const bool here = end - at >= static_cast<std::ptrdiff_t>(Tag::kBytes) && Tag::is_at(at);
    if (!here) {
      value = Value{};
      return;
    }
    std::memcpy(&value, at + Tag::kTagBytes, sizeof value);
    at += Tag::kBytes;
  }
  template <class Body>
  TELENANO_INLINE void run(const Body& body) noexcept {
    RunBytes run;
    body(run);
    if (end - at >= static_cast<std::ptrdiff_t>(run.bytes)) {
      RunTags tags{at};
      body(tags);
      if (tags.all) {
        RunValues values{at};
        body(values);
        at += run.bytes;
        return;
      }
    }
    body(*this);
  }
};

#undef TELENANO_INLINE
#undef TELENANO_INLINED

static_assert(std::endian::native == std::endian::little, "values go as they are");

}  // namespace telenano::link

#pragma once

#include <bit>
#include <cstdint>
#include <cstring>
#include <type_traits>

#include "telenano/common/link/messages.h"

/// The two messages of the stream, field by field, and a writer and a reader of their usual form: fixed-width
/// fields in rising order, zeros left out, as proto3 writes them. It is the same form on the wire as
/// Protobuf's (a test holds the two together, bit by bit); but each value is moved once instead of three
/// times (scan, parse, copy), which the loops feel. Whatever comes in another form is Protobuf's business.
///
/// One line a field: `visit.template operator()<NUMBER>(member)`, in rising order. Fields behind feature bits
/// stand apart: most sessions have none. `visit.run(…)` around fields says that they are mostly there, or
/// not there, together: a reader may then look at all their tags at once.
namespace telenano::link {

// A visitor writes bytes, and bytes may lie anywhere, also where it keeps its own place: unless all is one
// function, that place goes through memory at each field, and each field waits for the one before.
#define TELENANO_INLINED __attribute__((always_inline))
#define TELENANO_INLINE TELENANO_INLINED inline

template <std::uint32_t kFirst, class Visit, class Vector>
TELENANO_INLINE void visit_three(Visit& visit, Vector& v) noexcept {
  visit.run([&](auto& in) TELENANO_INLINED {
    in.template operator()<kFirst>(v.x());
    in.template operator()<kFirst + 1>(v.y());
    in.template operator()<kFirst + 2>(v.z());
  });
}

/// `Message` is Command or const Command, and so on.
template <class Message, class Visit>
requires std::is_same_v<std::remove_const_t<Message>, Command> TELENANO_INLINE void visit_fields(
    Message& m, Visit& visit) noexcept {
  visit.run([&](auto& in) TELENANO_INLINED {
    in.template operator()<1>(m.session_id);
    in.template operator()<2>(m.sequence);
    in.template operator()<3>(m.send_time_ns);
    in.template operator()<4>(m.newest_reply);
    in.template operator()<5>(m.epoch);
    in.template operator()<6>(m.flags);
  });
  visit_three<7>(visit, m.tip_vel_w_nm_s);
  visit_three<10>(visit, m.tip_pos_w_nm);
  visit.run([&](auto& in) TELENANO_INLINED {
    in.template operator()<13>(m.energy_in_j);
    in.template operator()<14>(m.energy_out_j);
  });
}

template <class Message, class Visit>
requires std::is_same_v<std::remove_const_t<Message>, Command> TELENANO_INLINE void visit_feature_fields(
    Message& m, Visit& visit) noexcept {
  visit.template operator()<15>(m.control.method);
  visit.template operator()<16>(m.control.energy_scale_aj_j);
  visit.template operator()<17>(m.control.energy_sent_j);
  visit_three<18>(visit, m.control.wave_sum);
  visit.template operator()<21>(m.control.wave_energy_aj);
  visit.template operator()<22>(m.control.wave_impedance_n_s_m);
  visit.template operator()<31>(m.tip_hold);
}

template <class Message, class Visit>
requires std::is_same_v<std::remove_const_t<Message>, Reply> TELENANO_INLINE void visit_fields(
    Message& m, Visit& visit) noexcept {
  visit.run([&](auto& in) TELENANO_INLINED {
    in.template operator()<1>(m.session_id);
    in.template operator()<2>(m.sequence);
    in.template operator()<3>(m.command_sequence);
    in.template operator()<4>(m.command_send_time_ns);
    in.template operator()<5>(m.server_time_ns);
    in.template operator()<6>(m.hold_time_ns);
  });
  visit.template operator()<7>(m.measurement_age_ns);
  visit.template operator()<8>(m.epoch);
  visit.template operator()<9>(m.contact_state);
  visit.template operator()<10>(m.fault_bits);
  visit_three<11>(visit, m.force_w_nn);
  visit_three<14>(visit, m.tip_pos_w_nm);
  visit.template operator()<17>(m.deflection_nm);
  visit.run([&](auto& in) TELENANO_INLINED {
    in.template operator()<18>(m.energy_in_aj);
    in.template operator()<19>(m.energy_out_aj);
  });
}

template <class Message, class Visit>
requires std::is_same_v<std::remove_const_t<Message>, Reply> TELENANO_INLINE void visit_feature_fields(
    Message& m, Visit& visit) noexcept {
  visit.template operator()<20>(m.port.energy_sent_aj);
  visit_three<21>(visit, m.port.wave_sum);
  visit.template operator()<24>(m.port.wave_energy_aj);
  visit.template operator()<25>(m.model.version);
  visit_three<26>(visit, m.model.point_w_nm);
  visit_three<29>(visit, m.model.normal_w);
  visit.run([&](auto& in) TELENANO_INLINED {
    in.template operator()<32>(m.model.stiffness_n_m);
    in.template operator()<33>(m.model.adhesion_nn);
    in.template operator()<34>(m.model.shear_stiffness_n_m);
    in.template operator()<35>(m.model.friction_nn);
  });
  visit.template operator()<36>(m.tip.hold);
  visit_three<37>(visit, m.tip.pos_w_nm);
  visit.template operator()<40>(m.steps_before);
  visit_three<41>(visit, m.particle.pos_w_nm);
  visit.template operator()<44>(m.particle.radius_nm);
  visit.template operator()<45>(m.particle.status);
  visit.template operator()<46>(m.steps.executed);
  visit.template operator()<47>(m.steps.state_hash);
  visit.template operator()<48>(m.steps.newest);
  visit.template operator()<49>(m.steps.breaks);
  visit.template operator()<50>(m.steps.break_reason);
  visit.template operator()<51>(m.steps.break_step);
}

template <class Message, class Visit>
requires std::is_same_v<std::remove_const_t<Message>, SnapshotRequest> TELENANO_INLINE void visit_fields(
    Message& m, Visit& visit) noexcept {
  visit.template operator()<1>(m.session_id);
  visit.template operator()<2>(m.snapshot);
  visit.template operator()<3>(m.piece);
}

/// Without its bytes.
template <class Message, class Visit>
requires std::is_same_v<std::remove_const_t<Message>, SnapshotPiece> TELENANO_INLINE void visit_fields(
    Message& m, Visit& visit) noexcept {
  visit.template operator()<1>(m.session_id);
  visit.template operator()<2>(m.snapshot);
  visit.template operator()<3>(m.piece);
  visit.template operator()<4>(m.step);
  visit.template operator()<5>(m.state_hash);
  visit.template operator()<6>(m.breaks);
  visit.template operator()<7>(m.total);
}

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

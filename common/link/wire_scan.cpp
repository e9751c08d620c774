#include "common/link/wire_scan.h"

#include <array>
#include <utility>

namespace telenano::link {
namespace {

constexpr std::array<std::uint8_t, 4> kMagic = {'T', 'L', 'N', 'O'};

// Wire types of Protobuf; 0 stands for "no such field", since no message here has a varint field.
constexpr std::uint8_t kNoField = 0;
constexpr std::uint8_t kF64 = 1;
constexpr std::uint8_t kLen = 2;
constexpr std::uint8_t kF32 = 5;

constexpr std::size_t kMaxFields = 24;

/// Wire type by field number, as in telenano.proto (the codec's tests hold the two together).
using FieldList = std::array<std::uint8_t, kMaxFields + 1>;

constexpr FieldList kHelloFields = {kNoField, kF32, kF32, kF64, kF64, kF64, kF64, kF32,
                                    0,        0,    0,    0,    0,    0,    0,    kLen};
constexpr FieldList kChallengeFields = {kNoField, kF64, kF64};
constexpr FieldList kWelcomeFields = {kNoField, kF32, kF64, kF64, kF64, kF64, kF32, kF32, kF32,
                                      kLen,     kF64, kF64, kF64, kF64, kF64, kF64, kF64, kF64,
                                      kF64,     kF64, kF64, kF64, kF64, kF64, kF64};
constexpr FieldList kRefuseFields = {kNoField, kF64, kF32, kF32, kF32};
constexpr FieldList kCommandFields = {kNoField, kF64, kF64, kF64, kF64, kF32, kF32, kF64,
                                      kF64,     kF64, kF64, kF64, kF64, kF64, kF64};
constexpr FieldList kReplyFields = {kNoField, kF64, kF64, kF64, kF64, kF64, kF64, kF64, kF32, kF32,
                                    kF32,     kF64, kF64, kF64, kF64, kF64, kF64, kF64, kF64, kF64};
constexpr FieldList kByeFields = {kNoField, kF64, kF32};
constexpr FieldList kNoFields = {};

/// The same list by tag (number << 3 | wire type), which is what is met on the wire: how far to go on, and
/// which bit says that the field was there. Tags of all lists lie below 256: one byte up to field 15, two
/// from field 16.
struct TagEntry {
  std::uint32_t bit = 0;
  std::uint32_t step =
      0;  ///< bytes of tag and value; 0 = not on the list, kLengthFollows = the length is next
};
constexpr std::uint32_t kLengthFollows = UINT32_MAX;
using TagTable = std::array<TagEntry, 256>;

constexpr TagTable tag_table(const FieldList& fields) {
  TagTable table{};
  for (std::uint32_t number = 1; number < fields.size(); ++number) {
    const std::uint8_t wire_type = fields[number];
    if (wire_type == kNoField) continue;
    const std::uint32_t tag_bytes = number < 16 ? 1 : 2;
    TagEntry& entry = table[(number << 3) | wire_type];
    entry.bit = 1u << number;
    entry.step = wire_type == kLen ? kLengthFollows : tag_bytes + (wire_type == kF32 ? 4u : 8u);
  }
  return table;
}

constexpr std::array<TagTable, 8> kTagTables = {tag_table(kNoFields),        tag_table(kHelloFields),
                                                tag_table(kChallengeFields), tag_table(kWelcomeFields),
                                                tag_table(kRefuseFields),    tag_table(kCommandFields),
                                                tag_table(kReplyFields),     tag_table(kByeFields)};

/// Reads a length of one or two bytes (all that fits a datagram), in its shortest form. False: cut or longer.
bool read_length(std::span<const std::uint8_t> bytes, std::size_t& at, std::size_t& value) noexcept {
  if (at >= bytes.size()) return false;
  value = bytes[at++];
  if (value < 0x80) return true;
  if (at >= bytes.size()) return false;
  const std::size_t high = bytes[at++];
  if (high >= 0x80 || high == 0) return false;
  value = (value & 0x7fu) | (high << 7);
  return true;
}

/// The usual case, quickly: the fields of the list in rising order, some left out (proto3 leaves out zeros),
/// none of them length-delimited. True is certain; false may only mean another order. The branch on each tag
/// goes the same way in nearly every datagram of a stream, so the processor runs ahead instead of waiting for
/// each field's place.
template <const FieldList& kFields, std::uint32_t... kIndex>
bool scan_in_order(std::span<const std::uint8_t> payload,
                   std::integer_sequence<std::uint32_t, kIndex...>) noexcept {
  const std::uint8_t* at = payload.data();
  const std::uint8_t* const end = at + payload.size();
  const auto field = [&at, end](std::uint32_t number, std::uint8_t wire_type) {
    if (wire_type == kNoField) return;
    const std::uint32_t tag = (number << 3) | wire_type;
    const std::ptrdiff_t step = (number < 16 ? 1 : 2) + (wire_type == kF32 ? 4 : 8);
    if (end - at < step) [[unlikely]]
      return;
    if (at[0] != tag || (number >= 16 && at[1] != 1)) [[unlikely]]
      return;
    at += step;
  };
  (field(kIndex, kFields[kIndex]), ...);
  return at == end;
}

template <const FieldList& kFields>
bool scan_in_order(std::span<const std::uint8_t> payload) noexcept {
  return scan_in_order<kFields>(payload, std::make_integer_sequence<std::uint32_t, kMaxFields + 1>());
}

/// True if every field is on the list, whole, and there once. `parse_bytes` ends before a Hello's padding.
bool scan_fields(MessageType type, std::span<const std::uint8_t> payload, std::size_t& parse_bytes) noexcept {
  const TagTable& table = kTagTables[static_cast<std::size_t>(type)];
  const std::uint8_t* const bytes = payload.data();
  const std::size_t size = payload.size();
  std::uint32_t seen = 0;
  std::size_t at = 0;
  parse_bytes = size;
  while (at < size) {
    const std::uint32_t tag = bytes[at];
    if (tag >= 0x80) {
      // The second byte of a tag below 256 is 1; anything else is a field beyond the lists or a longer form.
      if (at + 1 >= size || bytes[at + 1] != 1) return false;
    }
    const TagEntry entry = table[tag];
    if (entry.step == 0 || (seen & entry.bit) != 0) return false;
    seen |= entry.bit;
    if (entry.step != kLengthFollows) {
      at += entry.step;  // beyond the end: a field cut short, seen below
      continue;
    }
    const std::size_t field_start = at++;  // both fields of this kind have one-byte tags
    std::size_t length = 0;
    if (!read_length(payload, at, length)) return false;
    at += length;
    if (type == MessageType::kWelcome && length > kSceneNameBytes) return false;
    if (type == MessageType::kHello) {
      if (at != size) return false;
      parse_bytes = field_start;
    }
  }
  return at == size;
}

}  // namespace

void write_header(std::span<std::uint8_t, kHeaderBytes> out, MessageType type,
                  std::size_t payload_bytes) noexcept {
  for (std::size_t i = 0; i < kMagic.size(); ++i) out[i] = kMagic[i];
  out[4] = kProtocolVersion;
  out[5] = static_cast<std::uint8_t>(type);
  out[6] = static_cast<std::uint8_t>(payload_bytes & 0xffu);
  out[7] = static_cast<std::uint8_t>(payload_bytes >> 8);
}

DropCause scan(std::span<const std::uint8_t> datagram, WireFrame& frame) noexcept {
  frame = {};
  if (datagram.size() > kMaxDatagramBytes) return DropCause::kOversize;
  if (datagram.size() < kHeaderBytes) return DropCause::kTruncated;
  for (std::size_t i = 0; i < kMagic.size(); ++i) {
    if (datagram[i] != kMagic[i]) return DropCause::kBadMagic;
  }
  const std::uint8_t type_byte = datagram[5];
  const auto type = static_cast<MessageType>(type_byte);
  // Hello and Refuse never change their layout: they are how two versions find out about each other.
  const bool any_version = type == MessageType::kHello || type == MessageType::kRefuse;
  if (datagram[4] != kProtocolVersion && !any_version) return DropCause::kWrongVersion;
  if (type_byte == 0 || type_byte >= kTagTables.size()) return DropCause::kUnknownType;
  const std::size_t payload_bytes =
      static_cast<std::size_t>(datagram[6]) | (static_cast<std::size_t>(datagram[7]) << 8);
  const std::size_t behind_header = datagram.size() - kHeaderBytes;
  if (behind_header < payload_bytes) return DropCause::kTruncated;
  if (behind_header > payload_bytes) return DropCause::kBadLength;
  if (type == MessageType::kHello && datagram.size() != kMaxDatagramBytes) return DropCause::kBadLength;
  const auto payload = datagram.subspan(kHeaderBytes);
  std::size_t parse_bytes = payload_bytes;
  const bool in_order = (type == MessageType::kCommand && scan_in_order<kCommandFields>(payload)) ||
                        (type == MessageType::kReply && scan_in_order<kReplyFields>(payload));
  if (!in_order && !scan_fields(type, payload, parse_bytes)) return DropCause::kMalformedField;
  frame.type = type;
  frame.payload = payload.first(parse_bytes);
  return DropCause::kNone;
}

}  // namespace telenano::link

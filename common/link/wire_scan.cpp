#include "telenano/common/link/wire_scan.h"

#include <array>
#include <cstring>

#include "proto/wire_fields.h"
#include "telenano/common/link/recent_commands.h"
#include "telenano/common/link/step_log.h"

namespace telenano::link {
namespace {

constexpr std::array<std::uint8_t, 4> kMagic = {'T', 'L', 'N', 'O'};

/// A list of fields by tag (number << 3 | wire type), which is what is met on the wire: how far to go on, and
/// which field it is. One byte up to field 15, two from field 16 (seven bits each, the low ones first).
struct TagEntry {
  std::uint8_t number = 0;
  std::uint8_t step =
      0;  ///< bytes of tag and value; 0 = not on the list, kLengthFollows = the length is next
};
constexpr std::uint8_t kLengthFollows = UINT8_MAX;
using TagTable = std::array<TagEntry, 8 * (kMaxFields + 1)>;

constexpr std::size_t tag_bytes(std::uint32_t number) {
  return number < 16 ? 1 : 2;
}
constexpr std::size_t value_bytes(std::uint8_t wire_type) {
  return wire_type == kFixed32 ? 4 : 8;
}

/// The longest payload of a type: every field there, byte strings not counted.
constexpr std::size_t longest_payload(const FieldList& fields) {
  std::size_t bytes = 0;
  for (std::uint32_t number = 1; number < fields.size(); ++number) {
    if (fields[number] != kNoField && fields[number] != kByteString)
      bytes += tag_bytes(number) + value_bytes(fields[number]);
  }
  return bytes;
}
static_assert(longest_payload(kCommandFields) <= kMaxPayloadBytes &&
              longest_payload(kReplyFields) <= kMaxPayloadBytes);
static_assert(longest_payload(kWelcomeFields) + 2 + kSceneNameBytes == 342 &&
              longest_payload(kSceneChunkFields) + 3 + kSceneChunkBytes == 490);
static_assert(longest_payload(kCommandFields) + kRecentTagBytes + 2 + kMaxRecent * kRecentBytes <=
              kMaxPayloadBytes);

constexpr TagTable tag_table(const FieldList& fields) {
  TagTable table{};
  for (std::uint32_t number = 1; number < fields.size(); ++number) {
    const std::uint8_t wire_type = fields[number];
    if (wire_type == kNoField) continue;
    TagEntry& entry = table[(number << 3) | wire_type];
    entry.number = static_cast<std::uint8_t>(number);
    entry.step = wire_type == kByteString
                     ? kLengthFollows
                     : static_cast<std::uint8_t>(tag_bytes(number) + value_bytes(wire_type));
  }
  return table;
}

constexpr auto kTagTables = [] {
  std::array<TagTable, kFieldLists.size()> tables{};
  for (std::size_t type = 0; type < tables.size(); ++type) tables[type] = tag_table(kFieldLists[type]);
  return tables;
}();

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

// Where steps are logged, every command is answered: the deadband's two fields are not there.
constexpr std::size_t kDeadbandBytes = 2 * (2 + 4);
static_assert(longest_payload(kCommandFields) - kDeadbandBytes + kRecentTagBytes + 2 + kStepsBytesMost <=
              kMaxPayloadBytes);

/// Whole records, at least one; `at` is behind their length.
bool fits_recent(std::size_t length, std::size_t at, std::size_t size) noexcept {
  return length > 0 && length % kRecentBytes == 0 && length <= kMaxRecent * kRecentBytes &&
         at + length == size;
}

bool fits_steps(std::size_t length, std::size_t at, std::size_t size) noexcept {
  return length > kStepsHeaderBytes && length <= kStepsBytesMost && at + length == size;
}

/// True if every field is on the list, whole, and there once. `parse_bytes` ends before a Hello's padding and
/// before a Command's repeated commands.
/// True if every field is on the list, whole, and there once. `parse_bytes` ends before a Hello's padding,
/// before a Command's repeated commands and before a SceneChunk's bytes.
bool scan_fields(MessageType type, std::span<const std::uint8_t> payload, std::size_t& parse_bytes) noexcept {
  const TagTable& table = kTagTables[static_cast<std::size_t>(type)];
  const std::uint8_t* const bytes = payload.data();
  const std::size_t size = payload.size();
  std::uint64_t seen = 0;
  static_assert(kMaxFields < 64);
  std::size_t at = 0;
  parse_bytes = size;
  while (at < size) {
    std::size_t tag = bytes[at];
    if (tag >= 0x80) {
      // A second byte of 0 is a longer form of a short tag; one that makes the tag leave the table, a field
      // beyond all lists or a third byte.
      if (at + 1 >= size || bytes[at + 1] == 0) return false;
      tag = (tag & 0x7fu) | (static_cast<std::size_t>(bytes[at + 1]) << 7);
    }
    if (tag >= table.size()) return false;
    const TagEntry entry = table[tag];
    const std::uint64_t bit = std::uint64_t{1} << entry.number;
    if (entry.step == 0 || (seen & bit) != 0) return false;
    seen |= bit;
    if (entry.step != kLengthFollows) {
      at += entry.step;  // beyond the end: a field cut short, seen below
      continue;
    }
    const std::size_t field_start = at;
    at += tag_bytes(entry.number);
    std::size_t length = 0;
    if (!read_length(payload, at, length)) return false;
    if (type == MessageType::kCommand) {
      const bool fits =
          entry.number == kCommandSteps ? fits_steps(length, at, size) : fits_recent(length, at, size);
      if (!fits) return false;
      parse_bytes = field_start;
    }
    at += length;
    // The bytes of a piece are the last field; their length is checked where it is read.
    if (type == MessageType::kSnapshotPiece && at != size) return false;
    if (type == MessageType::kWelcome && length > kSceneNameBytes) return false;
    if (type == MessageType::kHello || type == MessageType::kSceneChunk) {
      if (at != size) return false;
      if (type == MessageType::kSceneChunk && (length == 0 || length > kSceneChunkBytes)) return false;
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

DropCause scan_header(std::span<const std::uint8_t> datagram, WireFrame& frame) noexcept {
  frame = {};
  if (datagram.size() > kMaxDatagramBytes) return DropCause::kOversize;
  if (datagram.size() < kHeaderBytes) return DropCause::kTruncated;
  if (std::memcmp(datagram.data(), kMagic.data(), kMagic.size()) != 0) return DropCause::kBadMagic;
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
  frame.type = type;
  frame.payload = datagram.subspan(kHeaderBytes);
  return DropCause::kNone;
}

bool take_tail(std::span<const std::uint8_t> payload, std::size_t at, WireFrame& frame) noexcept {
  const auto is_at = [&](std::uint32_t field) {
    const std::uint32_t tag = (field << 3) | kByteString;
    return payload[at] == ((tag & 0x7fu) | 0x80u) && payload[at + 1] == tag >> 7;
  };
  if (payload.size() - at < kRecentTagBytes) return false;
  const bool steps = is_at(kCommandSteps);
  if (!steps && !is_at(kCommandRecentCommands)) return false;
  at += kRecentTagBytes;
  std::size_t length = 0;
  if (!read_length(payload, at, length)) return false;
  if (steps ? !fits_steps(length, at, payload.size()) : !fits_recent(length, at, payload.size()))
    return false;
  (steps ? frame.steps : frame.recent) = payload.subspan(at);
  return true;
}

DropCause scan_payload(WireFrame& frame) noexcept {
  std::size_t parse_bytes = frame.payload.size();
  if (!scan_fields(frame.type, frame.payload, parse_bytes)) {
    frame = {};
    return DropCause::kMalformedField;
  }
  if (frame.type == MessageType::kCommand && parse_bytes < frame.payload.size())
    take_tail(frame.payload, parse_bytes, frame);
  if (frame.type == MessageType::kSceneChunk && parse_bytes < frame.payload.size()) {
    std::size_t at = parse_bytes + 1, length = 0;
    read_length(frame.payload, at, length);
    frame.data = frame.payload.subspan(at);
  }
  frame.payload = frame.payload.first(parse_bytes);
  return DropCause::kNone;
}

DropCause scan(std::span<const std::uint8_t> datagram, WireFrame& frame) noexcept {
  const DropCause cause = scan_header(datagram, frame);
  return cause == DropCause::kNone ? scan_payload(frame) : cause;
}

}  // namespace telenano::link

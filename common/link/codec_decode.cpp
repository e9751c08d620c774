#include <algorithm>

#include "telenano/common/link/codec.h"
#include "telenano/common/link/codec_messages.h"
#include "telenano/common/link/command_tail.h"
#include "telenano/common/link/flat_fields.h"
#include "telenano/common/link/message_checks.h"
#include "telenano/common/link/wire_scan.h"

namespace telenano::link {
namespace {

// What lies in a message and not in its fields alone.
template <class Wire, class Message>
void complete(const Wire&, Message&) noexcept {}

void complete(const wire::Welcome& w, Welcome& m) noexcept {
  m.scene_name = {};
  std::copy_n(w.scene_name().data(), std::min(w.scene_name().size(), kSceneNameBytes),
              m.scene_name.text.begin());
  m.steps.newest = m.steps.executed;
  m.steps.break_reason = 0;
  m.steps.break_step = 0;
}

template <class Wire, class Message>
DropCause parse(const WireFrame& frame, Wire& wire, Message& message) noexcept {
  if (!wire.ParseFromArray(frame.payload.data(), static_cast<int>(frame.payload.size()))) {
    return DropCause::kMalformedField;
  }
  from_wire(wire, message);
  complete(wire, message);
  return first_cause(check(message), check_features(message));
}

/// The usual form of the stream's messages (flat_fields.h). Where `used` is less than all of the payload,
/// what is behind came in another form.
template <class Message>
DropCause read_flat(std::span<const std::uint8_t> payload, Message& message, std::size_t& used) noexcept {
  FlatReader reader{payload.data(), payload.data() + payload.size()};
  visit_fields(message, reader);
  if (reader.at == reader.end) {  // most sessions: all of the others zero, which is in order
    used = payload.size();
    Clearing clearing;
    visit_feature_fields(message, clearing);
    return check(message);
  }
  visit_feature_fields(message, reader);
  used = static_cast<std::size_t>(reader.at - payload.data());
  return first_cause(check(message), check_features(message));
}

// These come in the usual form only: rising order, zeros left out, the bytes last.

/// Where the fields before the bytes end.
template <class Message>
const std::uint8_t* read_in_order(std::span<const std::uint8_t> payload, Message& m) noexcept {
  FlatReader reader{payload.data(), payload.data() + payload.size()};
  visit_fields(m, reader);
  return reader.at;
}

/// The bytes of this field, from `at` to the payload's end, 1 to `most`. False: they are something else.
bool read_last_bytes(std::span<const std::uint8_t> payload, const std::uint8_t* at, std::uint32_t field,
                     std::size_t most, std::span<const std::uint8_t>& data) noexcept {
  const std::uint8_t* const end = payload.data() + payload.size();
  data = {};
  if (at == end) return true;
  if (*at++ != ((field << 3) | 2u) || at == end) return false;
  std::size_t length = *at++;
  if (length >= 0x80) {
    if (at == end || *at == 0 || *at >= 0x80) return false;
    length = (length & 0x7fu) | (static_cast<std::size_t>(*at++) << 7);
  }
  if (length == 0 || length > most || static_cast<std::size_t>(end - at) != length) return false;
  data = {at, length};
  return true;
}

DropCause read_ordered(std::span<const std::uint8_t> payload, SnapshotRequest& m) noexcept {
  if (read_in_order(payload, m) != payload.data() + payload.size()) return DropCause::kMalformedField;
  return in_range(m.session_id != 0 && m.snapshot != 0);
}

DropCause read_ordered(std::span<const std::uint8_t> payload, SnapshotPiece& m) noexcept {
  std::span<const std::uint8_t> data;
  const std::uint8_t* const at = read_in_order(payload, m);
  if (!read_last_bytes(payload, at, kSnapshotPieceData, kSnapshotPieceBytes, data))
    return DropCause::kMalformedField;
  m.size = static_cast<std::uint32_t>(data.size());
  std::copy(data.begin(), data.end(), m.data.begin());
  return in_range(m.session_id != 0 && m.snapshot != 0);
}

DropCause read_ordered(std::span<const std::uint8_t> payload, SceneListRequest& m) noexcept {
  if (read_in_order(payload, m) != payload.data() + payload.size()) return DropCause::kMalformedField;
  return in_range(m.session_id != 0);
}

DropCause read_ordered(std::span<const std::uint8_t> payload, SceneListEntry& m) noexcept {
  std::span<const std::uint8_t> name;
  const std::uint8_t* const at = read_in_order(payload, m);
  if (!read_last_bytes(payload, at, kSceneListEntrySceneName, kSceneNameBytes, name))
    return DropCause::kMalformedField;
  m.scene_name = {};
  std::copy(name.begin(), name.end(), m.scene_name.text.begin());
  const bool named = !name.empty() && std::find(name.begin(), name.end(), 0) == name.end();
  return in_range(m.session_id != 0 && m.scene_hash != 0 && m.index < m.count && named);
}

DropCause read_ordered(std::span<const std::uint8_t> payload, SceneSwitch& m) noexcept {
  if (read_in_order(payload, m) != payload.data() + payload.size()) return DropCause::kMalformedField;
  return in_range(m.session_id != 0 && m.nonce != 0 && m.scene_hash != 0);
}

/// `is_one` false: it is none of these.
DropCause read_ordered(const WireFrame& frame, Incoming& in, bool& is_one) noexcept {
  is_one = true;
  switch (frame.type) {
    case MessageType::kSnapshotRequest:
      return read_ordered(frame.payload, in.snapshot_request);
    case MessageType::kSnapshotPiece:
      return read_ordered(frame.payload, in.snapshot_piece);
    case MessageType::kSceneListRequest:
      return read_ordered(frame.payload, in.scene_list_request);
    case MessageType::kSceneListEntry:
      return read_ordered(frame.payload, in.scene_list_entry);
    case MessageType::kSceneSwitch:
      return read_ordered(frame.payload, in.scene_switch);
    default:
      is_one = false;
      return DropCause::kNone;
  }
}

/// What stands behind a Command's fields.
DropCause read_tail(const WireFrame& frame, Incoming& incoming) noexcept {
  incoming.steps.count = 0;
  if (!frame.steps.empty() && !read_steps(frame.steps, incoming.steps)) return DropCause::kOutOfRange;
  return read_recent(frame.recent, incoming.command.sequence, incoming.recent);
}

}  // namespace

DropCause Codec::decode(std::span<const std::uint8_t> datagram, Incoming& incoming) noexcept {
  incoming.type = MessageType::kNone;
  WireFrame frame;
  DropCause cause = scan_header(datagram, frame);
  if (cause != DropCause::kNone) return cause;
  std::size_t used = 0;
  if (frame.type == MessageType::kCommand) {
    cause = read_flat(frame.payload, incoming.command, used);
    if (used == frame.payload.size() || take_tail(frame.payload, used, frame)) {
      cause = first_cause(cause, read_tail(frame, incoming));
      if (cause == DropCause::kNone) incoming.type = frame.type;
      return cause;
    }
  } else if (frame.type == MessageType::kReply) {
    cause = read_flat(frame.payload, incoming.reply, used);
    if (used == frame.payload.size()) {
      if (cause == DropCause::kNone) incoming.type = frame.type;
      return cause;
    }
  }
  bool ordered = false;
  cause = read_ordered(frame, incoming, ordered);
  if (ordered) {
    if (cause == DropCause::kNone) incoming.type = frame.type;
    return cause;
  }
  cause = scan_payload(frame);
  if (cause != DropCause::kNone) return cause;
  switch (frame.type) {
    case MessageType::kSnapshotRequest:
    case MessageType::kSnapshotPiece:
    case MessageType::kSceneListRequest:
    case MessageType::kSceneListEntry:
    case MessageType::kSceneSwitch:
      break;
    case MessageType::kHello:
      cause = parse(frame, messages_->hello, incoming.hello);
      break;
    case MessageType::kChallenge:
      cause = parse(frame, messages_->challenge, incoming.challenge);
      break;
    case MessageType::kWelcome:
      cause = parse(frame, messages_->welcome, incoming.welcome);
      break;
    case MessageType::kRefuse:
      cause = parse(frame, messages_->refuse, incoming.refuse);
      break;
    case MessageType::kCommand:
      cause = parse(frame, messages_->command, incoming.command);
      cause = first_cause(cause, read_tail(frame, incoming));
      break;
    case MessageType::kReply:
      cause = parse(frame, messages_->reply, incoming.reply);
      break;
    case MessageType::kBye:
      cause = parse(frame, messages_->bye, incoming.bye);
      break;
    case MessageType::kSceneRequest:
      cause = parse(frame, messages_->scene_request, incoming.scene_request);
      break;
    case MessageType::kSceneChunk:
      cause = parse(frame, messages_->scene_chunk, incoming.scene_chunk);
      incoming.scene_chunk.size = static_cast<std::uint32_t>(frame.data.size());
      std::copy(frame.data.begin(), frame.data.end(), incoming.scene_chunk.data.begin());
      if (frame.data.empty()) cause = first_cause(cause, DropCause::kOutOfRange);
      break;
    case MessageType::kNone:
      cause = DropCause::kUnknownType;
      break;
  }
  if (cause == DropCause::kNone) incoming.type = frame.type;
  return cause;
}

}  // namespace telenano::link

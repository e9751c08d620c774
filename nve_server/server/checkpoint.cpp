#include "telenano/nve_server/server/checkpoint.h"

#include <utility>

#include "telenano/nve_server/slave/state_bytes.h"

namespace telenano::server {
namespace {

constexpr std::uint64_t kMagic = 0x5450434f4e454c54;  // "TLENOCPT"
constexpr std::uint64_t kVersion = 1;
constexpr std::uint64_t kRateMost = 100'000;
constexpr std::uint64_t kRankMost = 2;

template <class V>
void head_fields(V& v, CheckpointHead& head) noexcept {
  v(head.of.scene_hash);
  v(head.of.physics);
  v(head.token);
  v(head.owner);
}

/// What is kept of the session, apart from its slave.
struct Kept {
  std::uint64_t epoch = 0;
  std::uint64_t rate_hz = 0;
  std::uint64_t feature_bits = 0;
  std::uint64_t rank = 0;
  bool used = false;
  Vec3 last_target_w_nm = Vec3::Zero();
  double behind_s = 0;
  std::uint64_t executed = 0;
  std::uint64_t breaks = 0;
  std::uint64_t break_reason = 0;
  std::uint64_t break_step = 0;
  std::uint64_t state_hash = 0;
};

template <class V>
void kept_fields(V& v, Kept& kept) noexcept {
  v(kept.epoch);
  v(kept.rate_hz);
  v(kept.feature_bits);
  v(kept.rank);
  v(kept.used);
  for (int i = 0; i < 3; ++i) v(kept.last_target_w_nm[i]);
  v(kept.behind_s);
  v(kept.executed);
  v(kept.breaks);
  v(kept.break_reason);
  v(kept.break_step);
  v(kept.state_hash);
}

bool in_range(const Kept& kept, const CheckpointHead& head) noexcept {
  return head.token != 0 && kept.epoch > 0 && kept.epoch <= UINT32_MAX && kept.rate_hz > 0 &&
         kept.rate_hz <= kRateMost && kept.rank <= kRankMost && kept.behind_s >= 0 &&
         kept.breaks <= UINT32_MAX && kept.break_reason <= UINT32_MAX && kept.break_step <= kept.executed &&
         kept.state_hash != 0;
}

template <class V>
bool begins_well(V& v) noexcept {
  std::uint64_t magic = kMagic;
  std::uint64_t version = kVersion;
  v(magic);
  v(version);
  return magic == kMagic && version == kVersion;
}

}  // namespace

namespace {

constexpr std::uint64_t kFileMagic = 0x46504b434f4e4c54;
constexpr std::uint64_t kFileVersion = 1;
// Public: it finds what is damaged. Who may write into the folder is trusted.
constexpr link::SipKey kSumKey{0x74656c656e616e6f, 0x636865636b706f69};

std::uint64_t sum_of(std::span<const std::uint8_t> before, std::span<const std::uint8_t> payload) noexcept {
  const std::uint64_t parts[] = {link::siphash(kSumKey, before), link::siphash(kSumKey, payload)};
  return link::siphash_words(kSumKey, parts);
}

}  // namespace

void seal(const CheckpointEnvelope& envelope, std::span<const std::uint8_t> payload,
          std::span<std::uint8_t, 40> before, std::span<std::uint8_t, 8> after) noexcept {
  slave::StateWriter writer(before);
  writer(kFileMagic);
  writer(kFileVersion);
  writer(envelope.written_ms);
  writer(envelope.number);
  writer(std::uint64_t{payload.size()});
  slave::StateWriter end(after);
  end(sum_of(before, payload));
}

std::span<const std::uint8_t> unseal(std::span<const std::uint8_t> file,
                                     CheckpointEnvelope& envelope) noexcept {
  if (file.size() <= kEnvelopeBytes) return {};
  const auto before = file.first(kEnvelopeBytes - 8);
  const auto payload = file.subspan(before.size(), file.size() - kEnvelopeBytes);
  slave::StateReader reader(before);
  std::uint64_t magic = 0;
  std::uint64_t version = 0;
  std::uint64_t size = 0;
  reader(magic);
  reader(version);
  reader(envelope.written_ms);
  reader(envelope.number);
  reader(size);
  std::uint64_t sum = 0;
  slave::StateReader(file.last(8))(sum);
  const bool whole = magic == kFileMagic && version == kFileVersion && size == payload.size() &&
                     sum == sum_of(before, payload);
  return whole ? payload : std::span<const std::uint8_t>();
}

std::size_t write_checkpoint(const CheckpointOf& of, const link::Session& session, const Tip& tip,
                             const SessionRecord& record, std::span<std::uint8_t> out) noexcept {
  if (!tip.slave) return 0;
  slave::StateWriter writer(out);
  begins_well(writer);
  CheckpointHead head{of, session.resume_token, session.owner};
  head_fields(writer, head);
  const link::StepReport steps = record.steps.enabled() ? record.steps.report() : record.steps_before;
  Kept kept;
  kept.epoch = session.epoch;
  kept.rate_hz = session.rate_hz;
  kept.feature_bits = session.feature_bits;
  kept.rank = session.rank;
  kept.used = session.used;
  kept.last_target_w_nm = tip.last_target_w_nm;
  kept.behind_s = record.behind_s;
  kept.executed = steps.executed;
  kept.breaks = steps.breaks;
  kept.break_reason = steps.break_reason;
  kept.break_step = steps.break_step;
  kept.state_hash = tip.slave->state_hash();
  kept_fields(writer, kept);
  PortControl::fields(writer, record.control);
  if (!writer.ok()) return 0;
  const std::size_t slave = tip.slave->save(out.subspan(writer.size()));
  return slave > 0 && kept.state_hash != 0 ? writer.size() + slave : 0;
}

bool read_checkpoint_head(std::span<const std::uint8_t> bytes, CheckpointHead& head) noexcept {
  slave::StateReader reader(bytes);
  if (!begins_well(reader)) return false;
  head_fields(reader, head);
  return reader.ok() && head.token != 0;
}

std::unique_ptr<SessionState> read_checkpoint(const CheckpointOf& of, std::span<const std::uint8_t> bytes,
                                              std::unique_ptr<slave::Slave> slave) {
  if (!slave) return nullptr;
  slave::StateReader reader(bytes);
  if (!begins_well(reader)) return nullptr;
  CheckpointHead head;
  head_fields(reader, head);
  Kept kept;
  kept_fields(reader, kept);
  auto state = std::make_unique<SessionState>();
  if (!PortControl::fields(reader, state->record.control) || !reader.ok() || !in_range(kept, head) ||
      head.of.scene_hash != of.scene_hash || head.of.physics != of.physics)
    return nullptr;
  if (!slave->load(bytes.subspan(reader.at())) || slave->state_hash() != kept.state_hash) return nullptr;

  link::Session& session = state->session;
  session.state = link::SlotState::kSilent;
  session.resume_token = head.token;
  session.owner = head.owner;
  session.epoch = static_cast<std::uint32_t>(kept.epoch);
  session.rate_hz = static_cast<std::uint32_t>(kept.rate_hz);
  session.feature_bits = kept.feature_bits;
  session.rank = static_cast<std::uint8_t>(kept.rank);
  session.used = kept.used;
  state->record.behind_s = kept.behind_s;
  state->record.restored = true;
  state->record.steps_before.executed = state->record.steps_before.newest = kept.executed;
  state->record.steps_before.breaks = static_cast<std::uint32_t>(kept.breaks);
  state->record.steps_before.break_reason = static_cast<std::uint32_t>(kept.break_reason);
  state->record.steps_before.break_step = kept.break_step;
  Tip& tip = state->tip;
  if (!slave->say_again(tip.output)) return nullptr;
  tip.slave = std::move(slave);
  tip.last_target_w_nm = kept.last_target_w_nm;
  tip.at_rest = false;
  return state;
}

}  // namespace telenano::server

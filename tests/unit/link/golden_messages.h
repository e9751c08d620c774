#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "telenano/common/link/codec.h"

namespace telenano::link {

/// The messages behind proto/golden/*.bin: every field set, each to another value, exact in binary.
struct GoldenMessages {
  Hello hello{1, 1, 0x0102030405060708, 0x1112131415161718, 0x2122232425262728, 0x3132333435363738, 4000};
  Challenge challenge{0x1112131415161718, 0x2122232425262728};
  Welcome welcome = make_welcome();
  Refuse refuse{0x1112131415161718, RefuseReason::kVersion, 1, 1};
  Command command = make_command();
  Reply reply = make_reply();
  Bye bye{0x4142434445464740, ByeReason::kDone};
  /// Every field behind a feature bit besides.
  Command command_with_features = make_command_with_features();
  Reply reply_with_features = make_reply_with_features();
  /// With sharing alone.
  Command command_with_sharing = make_command_with_sharing();
  Reply reply_with_sharing = make_reply_with_sharing();
  /// The command with steps: moving, at rest (a run), late, and a stop.
  StepBatch steps = make_steps();
  Reply reply_with_steps = make_reply_with_steps();
  Welcome welcome_with_steps = make_welcome_with_steps();
  SnapshotRequest snapshot_request{0x4142434445464740, 3, 2};
  SnapshotPiece snapshot_piece = make_snapshot_piece();
  /// That command with the four before it.
  /// The reply with features, and which commands came before its own.
  Reply reply_with_history = make_reply_with_history();
  /// The reply without features, and a particle.
  Reply reply_with_particle = make_reply_with_particle();
  Welcome welcome_with_well = make_welcome_with_well();
  Welcome welcome_with_scene = make_welcome_with_scene();
  SceneRequest scene_request{0x4142434445464740, 0x6162636465666768, 565};
  SceneChunk scene_chunk = make_scene_chunk();
  RecentCommands recent = make_recent();

  static Welcome make_welcome() {
    Welcome m;
    m.version = 1;
    m.feature_bits = 0;
    m.nonce = 0x1112131415161718;
    m.session_id = 0x4142434445464740;
    m.resume_token = 0x3132333435363738;
    m.epoch = 7;
    m.timeout_ms = 2000;
    m.slave_rate_max_hz = 8000;
    const std::string name = "flakes";
    std::copy(name.begin(), name.end(), m.scene_name.text.begin());
    m.scene_hash = 0x5152535455565758;
    m.workspace_min_w_nm = {-300, -300.5, -50};
    m.workspace_max_w_nm = {300, 300.5, 500};
    m.start_pos_w_nm = {1.5, -2.5, 80};
    m.surface_z_w_nm = 12.25;
    m.force_max_nn = 1000;
    m.coupling_stiffness_n_m = 0.75;
    m.coupling_damping_n_s_m = 0.0625;
    m.stiffness_min_n_m = -0.375;
    return m;
  }
  static Welcome make_welcome_with_well() {
    Welcome m = make_welcome();
    m.well_aj = 384.5;
    return m;
  }
  static Welcome make_welcome_with_scene() {
    Welcome m = make_welcome_with_well();
    m.scene = {{0x6162636465666768, 0x7172737475767778, 0x8182838485868788, 0x9192939495969798},
               262437,
               0xa1a2a3a4a5a6a7a8};
    return m;
  }
  static SceneChunk make_scene_chunk() {
    SceneChunk m;
    m.session_id = 0x4142434445464740;
    m.bundle = 0x6162636465666768;
    m.chunk = 565;
    m.size = 277;
    for (std::uint32_t i = 0; i < m.size; ++i) m.data[i] = static_cast<std::uint8_t>(7 * i + 3);
    return m;
  }
  static Command make_command() {
    Command m;
    m.session_id = 0x4142434445464740;
    m.sequence = 1001;
    m.send_time_ns = 123456789012345;
    m.newest_reply = 990;
    m.epoch = 7;
    m.flags = kFlagClutch | kFlagDeadman;
    m.tip_vel_w_nm_s = {10, -20, 30.5};
    m.tip_pos_w_nm = {1.125, -2.25, 3.5};
    m.energy_in_j = 0.03125;
    m.energy_out_j = 0.015625;
    return m;
  }
  static Reply make_reply() {
    Reply m;
    m.session_id = 0x4142434445464740;
    m.sequence = 999;
    m.command_sequence = 1001;
    m.command_send_time_ns = 123456789012345;
    m.server_time_ns = 987654321;
    m.hold_time_ns = 1500;
    m.measurement_age_ns = 250;
    m.epoch = 7;
    m.contact_state = ContactState::kContact;
    m.fault_bits = kFaultWorkspace;
    m.force_w_nn = {0.5, -0.25, 12.75};
    m.tip_pos_w_nm = {1.0, -2.0, 3.25};
    m.deflection_nm = 6.375;
    m.energy_in_aj = 4096.5;
    m.energy_out_aj = 1024.25;
    return m;
  }
  static Command make_command_with_features() {
    Command m = make_command();
    m.control.method = kMethodWave;
    m.control.energy_scale_aj_j = 2.5e17;
    m.control.energy_sent_j = 0.0078125;
    m.control.wave_sum = {-5.5, 6.25, -7.125};
    m.control.wave_energy_aj = 8192.5;
    m.control.wave_impedance_n_s_m = 0.00390625;
    return m;
  }
  static Reply make_reply_with_features() {
    Reply m = make_reply();
    m.port.energy_sent_aj = 512.5;
    m.port.wave_sum = {1.5, -2.75, 3.875};
    m.port.wave_energy_aj = 256.25;
    m.model.version = 42;
    m.model.point_w_nm = {11, -12.5, 13.25};
    m.model.normal_w = {0.75, -0.5, 0.4330127018922193};  // 9/16 + 1/4 + 3/16 = 1
    m.model.stiffness_n_m = 0.625;
    m.model.adhesion_nn = 17.5;
    m.model.shear_stiffness_n_m = 0.3125;
    m.model.friction_nn = 2.25;
    return m;
  }

  static Command make_command_with_sharing() {
    Command m = make_command();
    m.flags |= kFlagTakeOver;
    m.tip_hold = 5;
    return m;
  }
  static Reply make_reply_with_sharing() {
    Reply m = make_reply();
    m.tip = {6, {1.25, -2.5, 3.75}};
    return m;
  }
  static Reply make_reply_with_history() {
    Reply m = make_reply_with_features();
    m.steps_before = 0xfedcba9876543210;
    return m;
  }

  static Reply make_reply_with_particle() {
    Reply m = make_reply();
    m.particle = {{61.5, -7.25, 30.125}, 30.5, ParticleStatus::kHeld};
    return m;
  }

  static StepBatch make_steps() {
    StepBatch m;
    m.first = 1001;
    const LoggedStep moving{{18432, -36864, 57344}, 1'000'000, kFlagClutch | kFlagDeadman};
    LoggedStep late = moving, stopped = moving;
    late.target[2] -= 1000;
    late.dt_ns = 1'250'000;
    stopped = late;
    stopped.flags = kFlagStop;
    m.step[0] = m.step[1] = m.step[2] = moving;
    m.step[3] = late;
    m.step[4] = stopped;
    m.count = 5;
    return m;
  }
  static Reply make_reply_with_steps() {
    Reply m = make_reply();
    m.steps = {1000, 0x5152535455565758, 1005, 2, kBreakStop, 900};
    return m;
  }
  static Welcome make_welcome_with_steps() {
    Welcome m = make_welcome();
    m.steps = {1000, 0x5152535455565758, 1000, 2, 0, 0};
    return m;
  }
  static SnapshotPiece make_snapshot_piece() {
    SnapshotPiece m;
    m.session_id = 0x4142434445464740;
    m.snapshot = 3;
    m.piece = 2;
    m.step = 1000;
    m.state_hash = 0x5152535455565758;
    m.breaks = 2;
    m.total = 1064;
    m.size = 200;
    for (std::size_t i = 0; i < m.size; ++i) m.data[i] = static_cast<std::uint8_t>(7 * i + 1);
    return m;
  }

  static RecentCommands make_recent() {
    RecentCommands m;
    m.count = 4;
    for (std::size_t i = 0; i < m.count; ++i) {
      RecentCommand& r = m.record[i];
      const auto k = static_cast<double>(i + 1);
      r.age_ns = static_cast<std::uint32_t>(250'000 * (i + 1));
      r.flags = i == 3 ? std::uint32_t{kFlagDeadman} : kFlagClutch | kFlagDeadman;
      r.tip_pos_w_nm = {1.125 - 0.25 * k, -2.25 + 0.5 * k, 3.5 - 0.0625 * k};
      r.energy = 8192.5 - 16 * k;
      r.wave_sum = {-5.5 + k, 6.25 - k, -7.125 + 2 * k};
    }
    return m;
  }

  /// All of them as datagrams: the seven types in the order of their numbers, then those with features.
  std::vector<std::vector<std::uint8_t>> encoded() const {
    Codec codec;
    std::vector<std::vector<std::uint8_t>> all;
    const auto add = [&](const auto& message) {
      std::array<std::uint8_t, kMaxDatagramBytes> out{};
      const std::size_t n = codec.encode(message, out);
      all.emplace_back(out.begin(), out.begin() + static_cast<std::ptrdiff_t>(n));
    };
    add(hello);
    add(challenge);
    add(welcome);
    add(refuse);
    add(command);
    add(reply);
    add(bye);
    add(command_with_features);
    add(reply_with_features);
    std::array<std::uint8_t, kMaxDatagramBytes> out{};
    const std::size_t n = codec.encode(command_with_features, recent, out);
    all.emplace_back(out.begin(), out.begin() + static_cast<std::ptrdiff_t>(n));
    add(command_with_sharing);
    add(reply_with_sharing);
    add(reply_with_history);
    add(reply_with_particle);
    add(welcome_with_well);
    add(welcome_with_scene);
    add(scene_request);
    add(scene_chunk);
    std::array<std::uint8_t, kStepsBytesMost> bytes{};
    StepWriter writer(bytes, steps.first);
    for (std::size_t i = 0; i < steps.count; ++i) writer.add(steps.step[i]);
    const std::size_t with =
        codec.encode(command, std::span<const std::uint8_t>(bytes).first(writer.size()), out);
    all.emplace_back(out.begin(), out.begin() + static_cast<std::ptrdiff_t>(with));
    add(reply_with_steps);
    add(welcome_with_steps);
    add(snapshot_request);
    add(snapshot_piece);
    return all;
  }
};

inline constexpr std::array<const char*, 23> kGoldenNames = {"hello",
                                                             "challenge",
                                                             "welcome",
                                                             "refuse",
                                                             "command",
                                                             "reply",
                                                             "bye",
                                                             "command_with_features",
                                                             "reply_with_features",
                                                             "command_with_recent",
                                                             "command_with_sharing",
                                                             "reply_with_sharing",
                                                             "reply_with_history",
                                                             "reply_with_particle",
                                                             "welcome_with_well",
                                                             "welcome_with_scene",
                                                             "scene_request",
                                                             "scene_chunk",
                                                             "command_with_steps",
                                                             "reply_with_steps",
                                                             "welcome_with_steps",
                                                             "snapshot_request",
                                                             "snapshot_piece"};
inline constexpr std::array<MessageType, 23> kGoldenTypes = {
    MessageType::kHello,        MessageType::kChallenge,
    MessageType::kWelcome,      MessageType::kRefuse,
    MessageType::kCommand,      MessageType::kReply,
    MessageType::kBye,          MessageType::kCommand,
    MessageType::kReply,        MessageType::kCommand,
    MessageType::kCommand,      MessageType::kReply,
    MessageType::kReply,        MessageType::kReply,
    MessageType::kWelcome,      MessageType::kWelcome,
    MessageType::kSceneRequest, MessageType::kSceneChunk,
    MessageType::kCommand,      MessageType::kReply,
    MessageType::kWelcome,      MessageType::kSnapshotRequest,
    MessageType::kSnapshotPiece};

inline bool same(const Hello& a, const Hello& b) {
  return a.version_min == b.version_min && a.version_max == b.version_max &&
         a.feature_bits == b.feature_bits && a.nonce == b.nonce && a.cookie == b.cookie &&
         a.resume_token == b.resume_token && a.rate_hz == b.rate_hz;
}
inline bool same(const Challenge& a, const Challenge& b) {
  return a.nonce == b.nonce && a.cookie == b.cookie;
}
inline bool same(const Welcome& a, const Welcome& b) {
  return a.version == b.version && a.feature_bits == b.feature_bits && a.nonce == b.nonce &&
         a.session_id == b.session_id && a.resume_token == b.resume_token && a.epoch == b.epoch &&
         a.timeout_ms == b.timeout_ms && a.slave_rate_max_hz == b.slave_rate_max_hz &&
         a.scene_name == b.scene_name && a.scene_hash == b.scene_hash &&
         a.workspace_min_w_nm == b.workspace_min_w_nm && a.workspace_max_w_nm == b.workspace_max_w_nm &&
         a.start_pos_w_nm == b.start_pos_w_nm && a.surface_z_w_nm == b.surface_z_w_nm &&
         a.force_max_nn == b.force_max_nn && a.coupling_stiffness_n_m == b.coupling_stiffness_n_m &&
         a.coupling_damping_n_s_m == b.coupling_damping_n_s_m && a.stiffness_min_n_m == b.stiffness_min_n_m &&
         a.well_aj == b.well_aj && a.scene == b.scene && a.steps == b.steps;
}
inline bool same(const Refuse& a, const Refuse& b) {
  return a.nonce == b.nonce && a.reason == b.reason && a.version_min == b.version_min &&
         a.version_max == b.version_max;
}
inline bool same(const PortControl& a, const PortControl& b) {
  return a.method == b.method && a.energy_scale_aj_j == b.energy_scale_aj_j &&
         a.energy_sent_j == b.energy_sent_j && a.wave_sum == b.wave_sum &&
         a.wave_energy_aj == b.wave_energy_aj && a.wave_impedance_n_s_m == b.wave_impedance_n_s_m;
}
inline bool same(const PortAnswer& a, const PortAnswer& b) {
  return a.energy_sent_aj == b.energy_sent_aj && a.wave_sum == b.wave_sum &&
         a.wave_energy_aj == b.wave_energy_aj;
}
inline bool same(const LocalModel& a, const LocalModel& b) {
  return a.version == b.version && a.point_w_nm == b.point_w_nm && a.normal_w == b.normal_w &&
         a.stiffness_n_m == b.stiffness_n_m && a.adhesion_nn == b.adhesion_nn &&
         a.shear_stiffness_n_m == b.shear_stiffness_n_m && a.friction_nn == b.friction_nn;
}
inline bool same(const Command& a, const Command& b) {
  return a.session_id == b.session_id && a.sequence == b.sequence && a.send_time_ns == b.send_time_ns &&
         a.newest_reply == b.newest_reply && a.epoch == b.epoch && a.flags == b.flags &&
         a.tip_vel_w_nm_s == b.tip_vel_w_nm_s && a.tip_pos_w_nm == b.tip_pos_w_nm &&
         a.energy_in_j == b.energy_in_j && a.energy_out_j == b.energy_out_j && same(a.control, b.control) &&
         a.tip_hold == b.tip_hold;
}
inline bool same(const RecentCommands& a, const RecentCommands& b) {
  if (a.count != b.count) return false;
  for (std::size_t i = 0; i < a.count; ++i) {
    const RecentCommand &x = a.record[i], &y = b.record[i];
    if (x.age_ns != y.age_ns || x.flags != y.flags || x.tip_pos_w_nm != y.tip_pos_w_nm ||
        x.energy != y.energy || x.wave_sum != y.wave_sum)
      return false;
  }
  return true;
}
inline bool same(const Reply& a, const Reply& b) {
  return a.session_id == b.session_id && a.sequence == b.sequence &&
         a.command_sequence == b.command_sequence && a.command_send_time_ns == b.command_send_time_ns &&
         a.server_time_ns == b.server_time_ns && a.hold_time_ns == b.hold_time_ns &&
         a.measurement_age_ns == b.measurement_age_ns && a.epoch == b.epoch &&
         a.contact_state == b.contact_state && a.fault_bits == b.fault_bits && a.force_w_nn == b.force_w_nn &&
         a.tip_pos_w_nm == b.tip_pos_w_nm && a.deflection_nm == b.deflection_nm &&
         a.energy_in_aj == b.energy_in_aj && a.energy_out_aj == b.energy_out_aj && same(a.port, b.port) &&
         same(a.model, b.model) && a.tip.hold == b.tip.hold && a.tip.pos_w_nm == b.tip.pos_w_nm &&
         a.steps_before == b.steps_before && a.particle == b.particle && a.steps == b.steps;
}
inline bool same(const StepBatch& a, const StepBatch& b) {
  return a.count == b.count && (a.count == 0 || a.first == b.first) &&
         std::equal(a.step.begin(), a.step.begin() + static_cast<std::ptrdiff_t>(a.count), b.step.begin());
}
inline bool same(const SnapshotRequest& a, const SnapshotRequest& b) {
  return a.session_id == b.session_id && a.snapshot == b.snapshot && a.piece == b.piece;
}
inline bool same(const SnapshotPiece& a, const SnapshotPiece& b) {
  return a.session_id == b.session_id && a.snapshot == b.snapshot && a.piece == b.piece && a.step == b.step &&
         a.state_hash == b.state_hash && a.breaks == b.breaks && a.total == b.total && a.size == b.size &&
         std::equal(a.data.begin(), a.data.begin() + a.size, b.data.begin());
}
inline bool same(const Bye& a, const Bye& b) {
  return a.session_id == b.session_id && a.reason == b.reason;
}

inline bool same(const SceneRequest& a, const SceneRequest& b) {
  return a.session_id == b.session_id && a.bundle == b.bundle && a.chunk == b.chunk;
}
inline bool same(const SceneChunk& a, const SceneChunk& b) {
  return a.session_id == b.session_id && a.bundle == b.bundle && a.chunk == b.chunk && a.size == b.size &&
         std::equal(a.data.begin(), a.data.begin() + a.size, b.data.begin());
}

/// Is what was decoded the golden message number `which` (of kGoldenNames)?
inline bool matches(const Incoming& in, const GoldenMessages& golden, std::size_t which) {
  if (in.type != kGoldenTypes[which]) return false;
  switch (in.type) {
    case MessageType::kHello:
      return same(in.hello, golden.hello);
    case MessageType::kChallenge:
      return same(in.challenge, golden.challenge);
    case MessageType::kWelcome:
      return same(in.welcome, which < 7    ? golden.welcome
                              : which < 15 ? golden.welcome_with_well
                              : which < 16 ? golden.welcome_with_scene
                                           : golden.welcome_with_steps);
    case MessageType::kRefuse:
      return same(in.refuse, golden.refuse);
    case MessageType::kCommand:
      return same(in.command, which < 7 || which == 18 ? golden.command
                              : which < 10             ? golden.command_with_features
                                                       : golden.command_with_sharing) &&
             same(in.recent, which == 9 ? golden.recent : RecentCommands{}) &&
             same(in.steps, which == 18 ? golden.steps : StepBatch{});
    case MessageType::kReply:
      return same(in.reply, which < 7    ? golden.reply
                            : which < 10 ? golden.reply_with_features
                            : which < 12 ? golden.reply_with_sharing
                            : which < 13 ? golden.reply_with_history
                            : which < 14 ? golden.reply_with_particle
                                         : golden.reply_with_steps);
    case MessageType::kBye:
      return same(in.bye, golden.bye);
    case MessageType::kSceneRequest:
      return same(in.scene_request, golden.scene_request);
    case MessageType::kSceneChunk:
      return same(in.scene_chunk, golden.scene_chunk);
    case MessageType::kSnapshotRequest:
      return same(in.snapshot_request, golden.snapshot_request);
    case MessageType::kSnapshotPiece:
      return same(in.snapshot_piece, golden.snapshot_piece);
    case MessageType::kNone:
      return false;
  }
  return false;
}

}  // namespace telenano::link

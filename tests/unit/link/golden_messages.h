#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <string_view>
#include <vector>

#include "telenano/common/link/codec.h"
#include "tests/golden_values.h"

namespace telenano::link {

/// The messages behind proto/golden/*.bin, each field another value that is exact in binary. The values are those of
/// proto/golden/values.txt.
struct GoldenMessages : GoldenValues {
  /// Of command_with_steps: moving, at rest (a run), late, and a stop.
  StepBatch steps = make_steps();
  /// Of command_with_recent: the four commands before it.
  RecentCommands recent = make_recent();

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

  /// All of them as datagrams, in the order of kGoldenNames.
  std::vector<std::vector<std::uint8_t>> encoded() const {
    Codec codec;
    std::vector<std::vector<std::uint8_t>> all;
    std::array<std::uint8_t, kMaxDatagramBytes> out{};
    for (std::size_t which = 0; which < kGoldenNames.size(); ++which) {
      const std::string_view name = kGoldenNames[which];
      std::size_t n = 0;
      if (name == "command_with_recent") {
        n = codec.encode(command_with_recent, recent, out);
      } else if (name == "command_with_steps") {
        std::array<std::uint8_t, kStepsBytesMost> bytes{};
        StepWriter writer(bytes, steps.first);
        for (std::size_t i = 0; i < steps.count; ++i) writer.add(steps.step[i]);
        n = codec.encode(command_with_steps, std::span<const std::uint8_t>(bytes).first(writer.size()), out);
      } else {
        n = with(which, [&](const auto& message) { return codec.encode(message, out); });
      }
      all.emplace_back(out.begin(), out.begin() + static_cast<std::ptrdiff_t>(n));
    }
    return all;
  }
};

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
inline bool same(const StepBatch& a, const StepBatch& b) {
  return a.count == b.count && (a.count == 0 || a.first == b.first) &&
         std::equal(a.step.begin(), a.step.begin() + static_cast<std::ptrdiff_t>(a.count), b.step.begin());
}

inline bool same(const Hello& a, const Incoming& in) {
  return same(a, in.hello);
}
inline bool same(const Challenge& a, const Incoming& in) {
  return same(a, in.challenge);
}
inline bool same(const Welcome& a, const Incoming& in) {
  return same(a, in.welcome);
}
inline bool same(const Refuse& a, const Incoming& in) {
  return same(a, in.refuse);
}
inline bool same(const Command& a, const Incoming& in) {
  return same(a, in.command);
}
inline bool same(const Reply& a, const Incoming& in) {
  return same(a, in.reply);
}
inline bool same(const Bye& a, const Incoming& in) {
  return same(a, in.bye);
}
inline bool same(const SceneRequest& a, const Incoming& in) {
  return same(a, in.scene_request);
}
inline bool same(const SceneChunk& a, const Incoming& in) {
  return same(a, in.scene_chunk);
}
inline bool same(const SnapshotRequest& a, const Incoming& in) {
  return same(a, in.snapshot_request);
}
inline bool same(const SnapshotPiece& a, const Incoming& in) {
  return same(a, in.snapshot_piece);
}
inline bool same(const SceneListRequest& a, const Incoming& in) {
  return same(a, in.scene_list_request);
}
inline bool same(const SceneListEntry& a, const Incoming& in) {
  return same(a, in.scene_list_entry);
}
inline bool same(const SceneSwitch& a, const Incoming& in) {
  return same(a, in.scene_switch);
}

/// Is what was decoded the golden message number `which` (of kGoldenNames)?
inline bool matches(const Incoming& in, const GoldenMessages& golden, std::size_t which) {
  if (in.type != kGoldenTypes[which]) return false;
  if (!golden.with(which, [&](const auto& message) { return same(message, in); })) return false;
  if (in.type != MessageType::kCommand) return true;
  const std::string_view name = kGoldenNames[which];
  return same(in.recent, name == "command_with_recent" ? golden.recent : RecentCommands{}) &&
         same(in.steps, name == "command_with_steps" ? golden.steps : StepBatch{});
}

}  // namespace telenano::link

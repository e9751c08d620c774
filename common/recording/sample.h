#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>

/// One row of a recording: everything that the station knew and did in one tick. Plain data, so that the loop
/// can copy it into a queue in a few nanoseconds; the table `sample_columns()` says what each field is, and
/// datasets, their attributes, the reader and the report are all made from that table. Fields of the newest reply are
/// columns by telenano.proto. Frames W (sample) and
/// H (handle), see names.
namespace telenano::recording {

using Xyz = std::array<double, 3>;

/// Copies anything that is indexed 0..2 (a Vec3, an array) into a row.
template <class Vector>
Xyz xyz(const Vector& v) {
  return {v[0], v[1], v[2]};
}

/// Bits of Sample::limit_flags: what held the force of this tick back. Stored in files: never renumber.
enum LimitBits : std::uint32_t {
  kLimitDamper = 1u << 0,     ///< the adaptive damper injected damping
  kLimitClamp = 1u << 1,      ///< the energy clamp reduced the force
  kLimitForce = 1u << 2,      ///< the force limit reduced the force
  kLimitSlew = 1u << 3,       ///< the slew limit held the force back
  kLimitStale = 1u << 4,      ///< the last reply is old: force held or ramped to zero
  kLimitVelocity = 1u << 5,   ///< the velocity trip acted
  kLimitWorkspace = 1u << 6,  ///< the commanded position was kept inside the workspace
  kLimitRamp = 1u << 7,       ///< engage, reconnect or scale change: force is being blended in
  kLimitStop = 1u << 8,       ///< stop or deadman: zero force
  kLimitNonFinite = 1u << 9,  ///< a non-finite value was met: zero force
  kLimitObserves = 1u << 10,  ///< a shared tip is another session's, or nobody's: zero force
};

/// All 8-byte fields first, then an even number of 4-byte ones: no padding, so every byte is in the table.
struct Sample {
  std::int64_t tick = 0;
  double time_s = 0;

  Xyz hand_pos_h_m{};
  Xyz tip_target_w_nm{};
  Xyz tip_pos_w_nm{};
  Xyz force_w_nn{};
  Xyz hand_force_scaled_h_n{};
  Xyz hand_force_rendered_h_n{};
  Xyz hand_force_commanded_h_n{};
  Xyz hand_force_applied_h_n{};

  double damper_n_s_m = 0;
  double clamp_n = 0;
  double energy_j = 0;
  double energy_bound_j = 0;
  double energy_in_j = 0;
  double energy_out_j = 0;
  double account_j = 0;
  double slave_energy_in_aj = 0;
  double slave_energy_out_aj = 0;
  double deflection_nm = 0;
  double velocity_scale = 0;
  double force_scale = 0;

  std::int64_t reply_sequence = 0;
  double reply_age_ms = 0;
  double measurement_age_ms = 0;
  double rtt_us = 0;
  std::int64_t lost = 0;
  std::int64_t reordered = 0;
  std::int64_t duplicates = 0;
  std::int64_t dropped = 0;
  double rtt_smoothed_us = 0;
  double rtt_min_us = 0;
  double jitter_us = 0;
  double clock_offset_us = 0;
  double clock_drift_ppm = 0;
  double up_excess_us = 0;
  double down_excess_us = 0;
  double force_age_ms = 0;
  std::int64_t commands_sent = 0;
  std::int64_t commands_lost = 0;
  double playout_delay_ms = 0;
  std::int64_t playout_late = 0;

  double lateness_us = 0;
  double step_us = 0;
  std::int64_t overruns = 0;
  std::int64_t now_ns = 0;
  double dt_s = 0;
  std::int64_t sent_ns = 0;
  std::int64_t device_status = 0;

  // Later columns of the Reply: 64 bits each, behind these.
  Xyz particle_pos_w_nm{};
  double particle_radius_nm = 0;
  std::int64_t particle_state = 0;
  std::int64_t replies_left_out = 0;

  std::uint32_t contact_state = 0;
  std::uint32_t fault_bits = 0;
  std::uint32_t station_mode = 0;
  std::uint32_t limit_flags = 0;
  std::uint32_t station_faults = 0;
  std::uint32_t buttons = 0;
  std::uint32_t method = 0;
  std::uint32_t model_version = 0;
};

static_assert(std::is_trivially_copyable_v<Sample> && std::is_standard_layout_v<Sample>);

enum class ColumnType : std::uint8_t { kFloat64, kInt64, kUint32 };

/// How one field of Sample is stored: dataset /samples/<name>, `components` wide, with attributes unit,
/// description.
struct Column {
  const char* name;
  const char* unit;  ///< "1" for a pure number
  const char* description;
  ColumnType type;
  std::uint8_t components;
  std::size_t offset;  ///< of the field in Sample

  std::size_t element_bytes() const noexcept { return type == ColumnType::kUint32 ? 4 : 8; }
  std::size_t bytes() const noexcept { return element_bytes() * components; }
};

/// Every field of Sample, in order, without a gap.
std::span<const Column> sample_columns() noexcept;

/// A column that earlier programs called `former`. Files of theirs are read by `name`; new files lead from the
/// former name to the column by a soft link, so that scripts that ask for it go on.
struct RenamedColumn {
  const char* former;
  const char* name;
};
std::span<const RenamedColumn> renamed_columns() noexcept;

/// Something that happened at one moment: a fault, a mode change, a reconnect. Codes belong to the program
/// that writes them; the text explains. Texts longer than the field are cut.
struct Event {
  std::int64_t tick = 0;
  double time_s = 0;
  std::uint32_t code = 0;
  std::uint32_t value = 0;
  std::array<char, 64> text{};  ///< zero-padded
};

static_assert(std::is_trivially_copyable_v<Event> && std::is_standard_layout_v<Event>);

}  // namespace telenano::recording

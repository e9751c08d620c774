#include "telenano/common/recording/sample.h"

#include <algorithm>

#include "proto/reply_columns.h"

namespace telenano::recording {
namespace {

template <class Field>
constexpr ColumnType column_type() {
  using Element = std::remove_all_extents_t<Field>;
  if constexpr (std::is_same_v<Element, std::int64_t>) {
    return ColumnType::kInt64;
  } else if constexpr (std::is_same_v<Element, std::uint32_t>) {
    return ColumnType::kUint32;
  } else {
    static_assert(std::is_same_v<Element, double> || std::is_same_v<Element, Xyz>);
    return ColumnType::kFloat64;
  }
}

template <class Field>
constexpr std::uint8_t column_components() {
  return std::is_same_v<Field, Xyz> ? 3 : 1;
}

#define TELENANO_COLUMN(field, unit, description)                               \
  Column {                                                                      \
#field, unit, description, column_type < decltype(Sample::field)>(),        \
        column_components < decltype(Sample::field)>(), offsetof(Sample, field) \
  }

#define TELENANO_REPLY_COLUMN(name, unit, description, member) TELENANO_COLUMN(name, unit, description),

constexpr std::array kUnsorted{
    TELENANO_REPLY_COLUMNS(TELENANO_REPLY_COLUMN)  // what telenano.proto says of the Reply
    TELENANO_COLUMN(tick, "1", "tick of the station loop, from 0; a gap is a missed tick or a dropped row"),
    TELENANO_COLUMN(time_s, "s", "time since the start of the session, at the start of the tick"),
    TELENANO_COLUMN(hand_pos_h_m, "m", "hand position as the encoder sees it, frame H"),
    TELENANO_COLUMN(tip_target_w_nm, "nm", "commanded end of the virtual coupling, frame W"),
    TELENANO_COLUMN(hand_force_scaled_h_n, "N", "force on the hand as scaled from the reply, before control"),
    TELENANO_COLUMN(hand_force_rendered_h_n, "N",
                    "force that the control method shows, before damper, ramp and limits"),
    TELENANO_COLUMN(hand_force_commanded_h_n, "N",
                    "force sent to the device, after damper, limits and clamp"),
    TELENANO_COLUMN(hand_force_applied_h_n, "N",
                    "force that the device says it applies, held until the next tick"),
    TELENANO_COLUMN(damper_n_s_m, "N*s/m",
                    "adaptive damping injected by the passivity controller in this tick"),
    TELENANO_COLUMN(clamp_n, "N", "largest force that the energy clamp allowed in this tick"),
    TELENANO_COLUMN(energy_j, "J", "energy observer of the port: put in by the hand and not given back"),
    TELENANO_COLUMN(energy_bound_j, "J", "bound of the account's error caused by the encoder's quantum"),
    TELENANO_COLUMN(energy_in_j, "J", "energy that the hand has put into the port so far, monotone"),
    TELENANO_COLUMN(energy_out_j, "J", "energy that the port has given to the hand so far, monotone"),
    TELENANO_COLUMN(account_j, "J",
                    "energy in the control method's own account; the clamp bounds the force by it"),
    TELENANO_COLUMN(slave_energy_in_aj, "aJ",
                    "energy put into the slave's port so far, monotone in an epoch"),
    TELENANO_COLUMN(slave_energy_out_aj, "aJ",
                    "energy given back by the slave's port so far, monotone in an epoch"),
    TELENANO_COLUMN(velocity_scale, "1", "tip motion over hand motion, both in metres"),
    TELENANO_COLUMN(force_scale, "1", "hand force over tip force, both in newtons"),
    TELENANO_COLUMN(reply_sequence, "1", "sequence number of the newest reply accepted"),
    TELENANO_COLUMN(reply_age_ms, "ms", "time since the newest reply was accepted"),
    TELENANO_COLUMN(measurement_age_ms, "ms",
                    "age of a measured force when the reply was sent; 0: computed by a model"),
    TELENANO_COLUMN(rtt_us, "us",
                    "round trip of the newest reply, without the server's hold time; 0 = none yet"),
    TELENANO_COLUMN(lost, "1", "replies lost so far"),
    TELENANO_COLUMN(reordered, "1", "replies that came after a newer one so far"),
    TELENANO_COLUMN(duplicates, "1", "replies that came twice so far"),
    TELENANO_COLUMN(dropped, "1", "datagrams dropped so far for any other cause"),
    TELENANO_COLUMN(rtt_smoothed_us, "us", "smoothed round trip (RFC 6298)"),
    TELENANO_COLUMN(rtt_min_us, "us", "least round trip so far"),
    TELENANO_COLUMN(jitter_us, "us", "interarrival jitter of the replies (RFC 3550)"),
    TELENANO_COLUMN(clock_offset_us, "us",
                    "server's clock minus the station's, right within half of the least round trip"),
    TELENANO_COLUMN(clock_drift_ppm, "1e-6", "server's clock against the station's; 0 in the first second"),
    TELENANO_COLUMN(up_excess_us, "us", "newest exchange: delay to the server above the least"),
    TELENANO_COLUMN(down_excess_us, "us", "newest exchange: delay from the server above the least"),
    TELENANO_COLUMN(force_age_ms, "ms", "time since the slave measured the newest force that has come"),
    TELENANO_COLUMN(commands_sent, "1", "commands sent so far"),
    TELENANO_COLUMN(commands_lost, "1", "commands that the server did not get, or not in time, so far"),
    TELENANO_COLUMN(playout_delay_ms, "ms", "delay of the play-out buffer, from command to force; 0 = none"),
    TELENANO_COLUMN(playout_late, "1", "replies that came too late to be played out, so far"),
    TELENANO_COLUMN(lateness_us, "us", "how late this tick started"),
    TELENANO_COLUMN(step_us, "us", "how long the previous tick worked"),
    TELENANO_COLUMN(overruns, "1", "ticks missed so far because an earlier one took too long"),
    TELENANO_COLUMN(now_ns, "ns", "start of the tick, station clock"),
    TELENANO_COLUMN(dt_s, "s", "time since the last tick, as the control was told"),
    TELENANO_COLUMN(sent_ns, "ns", "when the tick's command was sent, station clock; 0 = none was"),
    TELENANO_COLUMN(device_status, "1", "of the haptic device: 0 well, 1 force off, 2 failed, 3 homing"),
    TELENANO_COLUMN(station_mode, "1", "mode of the station, see /configuration"),
    TELENANO_COLUMN(
        limit_flags, "1",
        "what held the force back: 1 damper, 2 clamp, 4 force limit, 8 slew, 16 stale force, 32 velocity, "
        "64 workspace, 128 ramp, 256 stop, 512 non-finite, 1024 observes a shared tip"),
    TELENANO_COLUMN(station_faults, "1", "latched faults of the station, see /configuration"),
    TELENANO_COLUMN(buttons, "1", "buttons of the device: 1 clutch, 2 deadman, 4 stop"),
    TELENANO_COLUMN(method, "1", "control method: 0 none, 1 ks, 2 ks-clamp, 3 tdpa, 4 wave, 5 tank, 6 model"),
};

#undef TELENANO_REPLY_COLUMN
#undef TELENANO_COLUMN

constexpr auto kColumns = [] {
  auto columns = kUnsorted;
  std::sort(columns.begin(), columns.end(),
            [](const Column& a, const Column& b) { return a.offset < b.offset; });
  return columns;
}();

constexpr bool covers_the_whole_sample() {
  std::size_t at = 0;
  for (const Column& column : kColumns) {
    if (column.offset != at) return false;
    at += std::size_t{column.type == ColumnType::kUint32 ? 4u : 8u} * column.components;
  }
  return at == sizeof(Sample);
}
static_assert(covers_the_whole_sample(), "a field of Sample is missing from the table, or out of order");

}  // namespace

std::span<const Column> sample_columns() noexcept {
  return kColumns;
}

std::span<const RenamedColumn> renamed_columns() noexcept {
  static constexpr std::array kRenamed{RenamedColumn{"ledger_j", "account_j"}};
  return kRenamed;
}

}  // namespace telenano::recording

#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace telenano::recording {

class RecordingReader;

/// Of a logarithmic histogram: right to 1/16 of the value, the largest exactly.
struct Percentiles {
  double p50 = 0;
  double p99 = 0;
  double max = 0;
};

/// What a person wants to know of a session first. The same whether it is gathered in the loop or from a
/// recording: SummaryBuilder makes both.
struct Summary {
  std::uint64_t rows = 0;
  std::uint64_t rows_dropped = 0;  ///< by the recorder
  double duration_s = 0;
  bool cut_short = false;  ///< the writer did not end in good order

  double pull_off_force_nn = 0;      ///< largest attraction along W z while the tip touches, >= 0
  double largest_attraction_nn = 0;  ///< at any time: without contact, the pull of van der Waals
  double peak_repulsion_nn = 0;      ///< largest push along W z, >= 0
  /// How far the tip went below the surface. Surface: the height under the start, when it is known and the
  /// tip stayed within 1 nm laterally, otherwise the height at which each contact began.
  double greatest_depth_nm = 0;
  bool depth_below_surface = false;  ///< which of the two
  double contact_fraction = 0;       ///< of all ticks, non-contact (adhesive neck) included
  double peak_hand_force_n = 0;      ///< applied
  double peak_scaled_force_n = 0;    ///< before control: what the hand would have felt
  double force_step_rms_n = 0;       ///< change of the applied force from tick to tick
  double hand_z_min_mm = 0;
  double hand_z_max_mm = 0;

  Percentiles rtt_us;        ///< over replies, not ticks
  std::int64_t replies = 0;  ///< that the server sent, as their sequence numbers tell
  std::int64_t lost = 0;
  std::int64_t reordered = 0;
  std::int64_t duplicates = 0;
  std::int64_t dropped = 0;
  double loss_fraction = 0;
  double jitter_us = 0;  ///< at the end, as the next two
  double clock_drift_ppm = 0;
  double rtt_min_us = 0;
  Percentiles force_age_us;  ///< over ticks that have a reply
  std::int64_t commands_sent = 0;
  std::int64_t commands_lost = 0;
  std::int64_t playout_late = 0;

  double energy_end_j = 0;    ///< observer, at the end
  double energy_least_j = 0;  ///< observer, its lowest
  double energy_in_j = 0;
  double energy_out_j = 0;
  double slave_energy_net_aj = 0;  ///< put into the slave's port and not given back

  double controller_duty = 0;  ///< fraction of ticks in which damper or clamp acted
  double damper_duty = 0;
  double clamp_duty = 0;
  double damper_max_n_s_m = 0;
  double force_limit_duty = 0;    ///< force or slew limit
  std::uint64_t stale_ticks = 0;  ///< ticks rendered from an old reply, held or ramped

  Percentiles lateness_us;
  Percentiles step_us;            ///< work in a tick
  std::int64_t overruns = 0;      ///< ticks whose work was not done at the next deadline
  std::int64_t missed_ticks = 0;  ///< periods that passed without a tick, as far as the rate is known
  std::uint32_t fault_bits = 0;   ///< all that were ever set
  std::uint32_t station_faults = 0;
  /// What their bits are called, "; " between them, the lowest first, as in /configuration; a bit without a
  /// name is told by its number.
  std::string slave_fault_names{};
  std::string station_fault_names{};
};

/// Feeds the rows of a recording through a SummaryBuilder. Throws UserError when the file cannot be read.
Summary summarise(const RecordingReader& reader);

/// The same as pairs of name and value with unit, in reading order and the same names for every session: for
/// tables.
std::vector<std::pair<std::string, std::string>> summary_lines(const Summary& summary);

/// As lines of text for a terminal, each indented by two blanks; without those that only contact could fill.
std::string summary_text(const Summary& summary);

}  // namespace telenano::recording

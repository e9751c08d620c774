#include "common/recording/summary.h"

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>

namespace telenano::recording {
namespace {

using Values = std::vector<double>;

Percentiles percentiles(Values values) {
  if (values.empty()) return {};
  std::sort(values.begin(), values.end());
  const auto at = [&](double q) {
    const auto rank = static_cast<std::size_t>(std::ceil(q * static_cast<double>(values.size())));
    return values[std::clamp<std::size_t>(rank, 1, values.size()) - 1];
  };
  return {at(0.5), at(0.99), values.back()};
}

Values read(const RecordingReader& reader, const char* column, std::size_t component = 0) {
  return reader.has(column) ? reader.read(column, component) : Values(reader.rows(), 0.0);
}

Values norms(const RecordingReader& reader, const char* column) {
  const Values x = read(reader, column, 0);
  const Values y = read(reader, column, 1);
  const Values z = read(reader, column, 2);
  Values result(x.size());
  for (std::size_t i = 0; i < x.size(); ++i) result[i] = std::sqrt(x[i] * x[i] + y[i] * y[i] + z[i] * z[i]);
  return result;
}

double largest(const Values& values) {
  double most = 0;
  for (const double value : values) most = std::max(most, value);
  return most;
}

double last(const Values& values) {
  return values.empty() ? 0.0 : values.back();
}
std::int64_t last_count(const RecordingReader& reader, const char* column) {
  return static_cast<std::int64_t>(last(read(reader, column)));
}

double spread(const Values& values) {
  if (values.empty()) return 0;
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  return *high - *low;
}

double greatest_depth(const RecordingReader& reader, const Values& state) {
  const Values z = read(reader, "tip_pos_w_nm", 2);
  const std::string surface = reader.configuration("surface_z_w_nm");
  const bool known = !surface.empty() && spread(read(reader, "tip_target_w_nm", 0)) < 1.0 &&
                     spread(read(reader, "tip_target_w_nm", 1)) < 1.0;
  double reference = known ? std::strtod(surface.c_str(), nullptr) : 0.0;
  double depth = 0;
  for (std::size_t i = 0; i < z.size(); ++i) {
    if (state[i] < 2) continue;
    if (!known && (i == 0 || state[i - 1] < 2)) reference = z[i];
    depth = std::max(depth, reference - z[i]);
  }
  return depth;
}

void summarise_force(const RecordingReader& reader, Summary& summary) {
  const Values state = read(reader, "contact_state");
  for (const double f : read(reader, "force_w_nn", 2)) {
    summary.pull_off_force_nn = std::max(summary.pull_off_force_nn, -f);
    summary.peak_repulsion_nn = std::max(summary.peak_repulsion_nn, f);
  }
  summary.greatest_depth_nm = greatest_depth(reader, state);
  const auto touching = std::count_if(state.begin(), state.end(), [](double s) { return s >= 2; });
  summary.contact_fraction =
      static_cast<double>(touching) / static_cast<double>(std::max<std::size_t>(state.size(), 1));
  summary.peak_hand_force_n = largest(norms(reader, "hand_force_applied_h_n"));
  summary.peak_scaled_force_n = largest(norms(reader, "hand_force_scaled_h_n"));
  double sum = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const Values f = read(reader, "hand_force_applied_h_n", axis);
    for (std::size_t i = 1; i < f.size(); ++i) sum += (f[i] - f[i - 1]) * (f[i] - f[i - 1]);
  }
  if (summary.rows > 1) summary.force_step_rms_n = std::sqrt(sum / static_cast<double>(summary.rows - 1));
}

void summarise_link(const RecordingReader& reader, Summary& summary) {
  const Values sequence = read(reader, "reply_sequence");
  const Values rtt = read(reader, "rtt_us");
  Values of_replies;
  for (std::size_t i = 0; i < rtt.size(); ++i) {
    const bool fresh = i == 0 ? sequence[i] > 0 : sequence[i] != sequence[i - 1];
    if (fresh && rtt[i] > 0) of_replies.push_back(rtt[i]);
  }
  summary.rtt_us = percentiles(std::move(of_replies));
  summary.replies = static_cast<std::int64_t>(largest(sequence));
  summary.lost = last_count(reader, "lost");
  summary.reordered = last_count(reader, "reordered");
  summary.duplicates = last_count(reader, "duplicates");
  summary.dropped = last_count(reader, "dropped");
  if (summary.replies > 0) {
    summary.loss_fraction = static_cast<double>(summary.lost) / static_cast<double>(summary.replies);
  }
}

void summarise_control(const RecordingReader& reader, Summary& summary) {
  const Values energy = read(reader, "energy_j");
  summary.energy_end_j = last(energy);
  summary.energy_least_j = energy.empty() ? 0.0 : *std::min_element(energy.begin(), energy.end());
  summary.energy_in_j = last(read(reader, "energy_in_j"));
  summary.energy_out_j = last(read(reader, "energy_out_j"));
  summary.slave_energy_net_aj =
      last(read(reader, "slave_energy_in_aj")) - last(read(reader, "slave_energy_out_aj"));

  const Values damper = read(reader, "damper_n_s_m");
  const Values flags = read(reader, "limit_flags");
  std::uint64_t damped = 0;
  std::uint64_t clamped = 0;
  std::uint64_t acted = 0;
  std::uint64_t limited = 0;
  for (std::size_t i = 0; i < flags.size(); ++i) {
    const auto bits = static_cast<std::uint32_t>(flags[i]);
    const bool by_damper = damper[i] > 0 || (bits & kLimitDamper) != 0;
    const bool by_clamp = (bits & kLimitClamp) != 0;
    damped += by_damper ? 1 : 0;
    clamped += by_clamp ? 1 : 0;
    acted += by_damper || by_clamp ? 1 : 0;
    limited += (bits & (kLimitForce | kLimitSlew)) != 0 ? 1 : 0;
    summary.stale_ticks += (bits & kLimitStale) != 0 ? 1 : 0;
  }
  const double ticks = static_cast<double>(std::max<std::size_t>(flags.size(), 1));
  summary.damper_duty = static_cast<double>(damped) / ticks;
  summary.clamp_duty = static_cast<double>(clamped) / ticks;
  summary.controller_duty = static_cast<double>(acted) / ticks;
  summary.force_limit_duty = static_cast<double>(limited) / ticks;
  summary.damper_max_n_s_m = largest(damper);
}

void summarise_timing(const RecordingReader& reader, Summary& summary) {
  summary.lateness_us = percentiles(read(reader, "lateness_us"));
  summary.overruns = last_count(reader, "overruns");
  const Values tick = read(reader, "tick");
  if (!tick.empty()) {
    const auto ticks = static_cast<std::int64_t>(tick.back() - tick.front()) + 1;
    summary.missed_ticks = std::max<std::int64_t>(0, ticks - static_cast<std::int64_t>(tick.size()));
  }
  for (const double bits : read(reader, "fault_bits")) summary.fault_bits |= static_cast<std::uint32_t>(bits);
  for (const double bits : read(reader, "station_faults"))
    summary.station_faults |= static_cast<std::uint32_t>(bits);
}

__attribute__((format(printf, 1, 2))) std::string text(const char* format, ...) {
  char buffer[256];
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(buffer, sizeof buffer, format, arguments);
  va_end(arguments);
  return buffer;
}

}  // namespace

Summary summarise(const RecordingReader& reader) {
  Summary summary;
  summary.rows = reader.rows();
  summary.rows_dropped = reader.rows_dropped();
  summary.cut_short = reader.cut_short();
  if (summary.rows == 0) return summary;
  const Values time = read(reader, "time_s");
  summary.duration_s = time.back() - time.front();
  summarise_force(reader, summary);
  summarise_link(reader, summary);
  summarise_control(reader, summary);
  summarise_timing(reader, summary);
  return summary;
}

std::vector<std::pair<std::string, std::string>> summary_lines(const Summary& s) {
  std::vector<std::pair<std::string, std::string>> lines;
  const auto add = [&](const char* name, std::string value) { lines.emplace_back(name, std::move(value)); };
  add("duration", text("%.2f s, %llu ticks%s", s.duration_s, static_cast<unsigned long long>(s.rows),
                       s.cut_short ? " (cut short)" : ""));
  add("pull-off force", text("%.4g nN", s.pull_off_force_nn));
  add("peak repulsion", text("%.4g nN", s.peak_repulsion_nn));
  add("greatest depth", text("%.3g nm", s.greatest_depth_nm));
  add("in contact", text("%.1f %% of the time", 100 * s.contact_fraction));
  add("peak force at the hand",
      text("%.3g N (%.3g N before control)", s.peak_hand_force_n, s.peak_scaled_force_n));
  add("force step, RMS", text("%.3g N a tick", s.force_step_rms_n));
  add("round trip p50 / p99 / max", text("%.0f / %.0f / %.0f us", s.rtt_us.p50, s.rtt_us.p99, s.rtt_us.max));
  add("replies lost", text("%lld of %lld (%.2f %%)", static_cast<long long>(s.lost),
                           static_cast<long long>(s.replies), 100 * s.loss_fraction));
  add("reordered / duplicate / other drops",
      text("%lld / %lld / %lld", static_cast<long long>(s.reordered), static_cast<long long>(s.duplicates),
           static_cast<long long>(s.dropped)));
  add("energy ledger, least / end", text("%.3g / %.3g mJ", 1e3 * s.energy_least_j, 1e3 * s.energy_end_j));
  add("energy in / out at the hand", text("%.4g / %.4g mJ", 1e3 * s.energy_in_j, 1e3 * s.energy_out_j));
  add("energy left at the tip", text("%.4g aJ", s.slave_energy_net_aj));
  add("controller duty", text("%.1f %% (damper %.1f %%, clamp %.1f %%)", 100 * s.controller_duty,
                              100 * s.damper_duty, 100 * s.clamp_duty));
  add("largest damper", text("%.3g N s/m", s.damper_max_n_s_m));
  add("force or slew limit", text("%.1f %% of the time", 100 * s.force_limit_duty));
  add("stale force", text("%llu ticks", static_cast<unsigned long long>(s.stale_ticks)));
  add("lateness p50 / p99 / max",
      text("%.0f / %.0f / %.0f us", s.lateness_us.p50, s.lateness_us.p99, s.lateness_us.max));
  add("overruns / missed ticks",
      text("%lld / %lld", static_cast<long long>(s.overruns), static_cast<long long>(s.missed_ticks)));
  add("rows not recorded", text("%llu", static_cast<unsigned long long>(s.rows_dropped)));
  add("faults", s.fault_bits == 0 && s.station_faults == 0
                    ? std::string("none")
                    : text("slave 0x%x, station 0x%x", s.fault_bits, s.station_faults));
  return lines;
}

std::string summary_text(const Summary& summary) {
  std::string result;
  for (const auto& [name, value] : summary_lines(summary))
    result += text("  %-36s %s\n", name.c_str(), value.c_str());
  return result;
}

}  // namespace telenano::recording

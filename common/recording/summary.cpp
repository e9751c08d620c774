#include "telenano/common/recording/summary.h"

#include <algorithm>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <span>

#include "telenano/common/recording/recording_reader.h"
#include "telenano/common/recording/summary_builder.h"

namespace telenano::recording {
namespace {

const std::string kNoContact = "no contact";

__attribute__((format(printf, 1, 2))) std::string text(const char* format, ...) {
  char buffer[256];
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(buffer, sizeof buffer, format, arguments);
  va_end(arguments);
  return buffer;
}

// The names of the bits that are set; `names`: of all, "; " between them, the lowest first.
std::string names_of(std::uint32_t bits, const std::string& names) {
  std::string words;
  std::size_t from = 0;
  for (unsigned bit = 0; bit < 32; ++bit) {
    const std::size_t to = std::min(names.find("; ", from), names.size());
    const std::string name = from < names.size() ? names.substr(from, to - from) : "";
    from = to + 2;
    if ((bits >> bit & 1u) == 0) continue;
    words += (words.empty() ? "" : ", ") + (name.empty() ? text("bit %u", bit) : name);
  }
  return words;
}

std::string fault_text(const Summary& s) {
  std::string words;
  if (s.fault_bits != 0) words = "slave: " + names_of(s.fault_bits, s.slave_fault_names);
  if (s.station_faults == 0) return words;
  return words + (words.empty() ? "station: " : "; station: ") +
         names_of(s.station_faults, s.station_fault_names);
}

}  // namespace

Summary summarise(const RecordingReader& reader) {
  SummaryContext context;
  context.rate_hz = std::strtod(reader.configuration("rate_hz").c_str(), nullptr);
  const std::string surface = reader.configuration("surface_z_w_nm");
  if (!surface.empty()) context.surface_z_w_nm = std::strtod(surface.c_str(), nullptr);
  SummaryBuilder builder(context);
  std::vector<Sample> block(4096);
  for (std::size_t first = 0; first < reader.rows(); first += block.size()) {
    const std::size_t count = std::min(block.size(), reader.rows() - first);
    reader.read_samples(first, std::span(block).first(count));
    for (const Sample& sample : std::span(block).first(count)) builder.add(sample);
  }
  Summary summary = builder.finish();
  summary.rows_dropped = reader.rows_dropped();
  summary.cut_short = reader.cut_short();
  summary.slave_fault_names = reader.configuration("slave_fault_names");
  summary.station_fault_names = reader.configuration("station_fault_names");
  return summary;
}

std::vector<std::pair<std::string, std::string>> summary_lines(const Summary& s) {
  std::vector<std::pair<std::string, std::string>> lines;
  const auto add = [&](const char* name, std::string value) { lines.emplace_back(name, std::move(value)); };
  add("duration", text("%.2f s, %llu ticks%s", s.duration_s, static_cast<unsigned long long>(s.rows),
                       s.cut_short ? " (cut short)" : ""));
  const bool touched = s.contact_fraction > 0;
  add("pull-off force", touched ? text("%.4g nN", s.pull_off_force_nn) : kNoContact);
  add("largest attraction", text("%.4g nN", s.largest_attraction_nn));
  add("largest push", text("%.4g nN", s.peak_repulsion_nn));
  add("greatest depth", touched ? text("%.3g nm below %s", s.greatest_depth_nm,
                                       s.depth_below_surface ? "the surface" : "where contact began")
                                : kNoContact);
  add("in contact", text("%.1f %% of the time", 100 * s.contact_fraction));
  add("hand force, peak", text("%.3g N (%.3g N before control)", s.peak_hand_force_n, s.peak_scaled_force_n));
  add("force step, RMS", text("%.3g N a tick", s.force_step_rms_n));
  add("hand, z from / to", text("%.3g / %.3g mm", s.hand_z_min_mm, s.hand_z_max_mm));
  add("round trip p50 / p99 / max", text("%.0f / %.0f / %.0f us", s.rtt_us.p50, s.rtt_us.p99, s.rtt_us.max));
  add("round trip, least; jitter", text("%.0f us; %.1f us", s.rtt_min_us, s.jitter_us));
  add("clock drift of the server", text("%+.1f ppm", s.clock_drift_ppm));
  add("age of the force p50 / p99 / max", text("%.2f / %.2f / %.2f ms", 1e-3 * s.force_age_us.p50,
                                               1e-3 * s.force_age_us.p99, 1e-3 * s.force_age_us.max));
  add("commands lost or overtaken",
      text("%lld of %lld", static_cast<long long>(s.commands_lost), static_cast<long long>(s.commands_sent)));
  add("replies too late for play-out", text("%lld", static_cast<long long>(s.playout_late)));
  add("replies lost", text("%lld of %lld (%.2f %%)", static_cast<long long>(s.lost),
                           static_cast<long long>(s.replies), 100 * s.loss_fraction));
  add("reordered / duplicate / other drops",
      text("%lld / %lld / %lld", static_cast<long long>(s.reordered), static_cast<long long>(s.duplicates),
           static_cast<long long>(s.dropped)));
  add("port energy, least / end", text("%.4g / %.4g mJ", 1e3 * s.energy_least_j, 1e3 * s.energy_end_j));
  add("energy in / out at the hand", text("%.4g / %.4g mJ", 1e3 * s.energy_in_j, 1e3 * s.energy_out_j));
  add("energy left at the tip", text("%.4g aJ", s.slave_energy_net_aj));
  add("controller acted in", text("%.1f %% of the ticks (damper %.1f %%, clamp %.1f %%)",
                                  100 * s.controller_duty, 100 * s.damper_duty, 100 * s.clamp_duty));
  add("largest damper", text("%.4g N s/m", s.damper_max_n_s_m));
  add("force or slew limit", text("%.1f %% of the time", 100 * s.force_limit_duty));
  add("stale force", text("%llu ticks", static_cast<unsigned long long>(s.stale_ticks)));
  add("lateness p50 / p99 / max",
      text("%.0f / %.0f / %.0f us", s.lateness_us.p50, s.lateness_us.p99, s.lateness_us.max));
  add("work in a tick p50 / p99 / max",
      text("%.1f / %.1f / %.1f us", s.step_us.p50, s.step_us.p99, s.step_us.max));
  add("overruns / missed ticks",
      text("%lld / %lld", static_cast<long long>(s.overruns), static_cast<long long>(s.missed_ticks)));
  add("rows not recorded", text("%llu", static_cast<unsigned long long>(s.rows_dropped)));
  add("faults", s.fault_bits == 0 && s.station_faults == 0 ? std::string("none") : fault_text(s));
  return lines;
}

std::string summary_text(const Summary& summary) {
  std::string result;
  for (const auto& [name, value] : summary_lines(summary)) {
    if (value != kNoContact) result += text("  %-36s %s\n", name.c_str(), value.c_str());
  }
  return result;
}

}  // namespace telenano::recording

#include "tests/studies/report/run_data.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "telenano/common/base/error.h"
#include "telenano/common/recording/recording_reader.h"
#include "tests/studies/report/decimate.h"

namespace telenano::studies {
namespace {

using Values = std::vector<double>;

Values shifted_scaled(Values values, double shift, double scale) {
  for (double& value : values) value = (value - shift) * scale;
  return values;
}

/// The name of the lowest bit that is set, from a list in the order of the bits, parted by "; ".
std::string fault_name(std::string names, unsigned bits) {
  for (unsigned bit = bits; bit != 0 && (bit & 1u) == 0 && !names.empty(); bit >>= 1) {
    const auto next = names.find("; ");
    names = next == std::string::npos ? "" : names.substr(next + 2);
  }
  return names.empty() ? "fault bits " + std::to_string(bits) : names.substr(0, names.find("; "));
}

std::vector<std::pair<double, double>> find_contacts(const Values& time_s, const Values& state) {
  std::vector<std::pair<double, double>> contacts;
  for (std::size_t i = 0; i < state.size(); ++i) {
    if (state[i] < 2) continue;
    // Flickering at the border of contact is one contact to the eye.
    const bool goes_on = !contacts.empty() && time_s[i] - contacts.back().second < 0.005 * time_s.back();
    if (goes_on) {
      contacts.back().second = time_s[i];
    } else {
      contacts.emplace_back(time_s[i], time_s[i]);
    }
  }
  if (contacts.size() > 60) contacts.resize(60);
  return contacts;
}

}  // namespace

std::string slug_of(const std::string& label) {
  std::string slug;
  for (const char c : label) {
    if (std::isalnum(static_cast<unsigned char>(c)) != 0) {
      slug += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    } else if (!slug.empty() && slug.back() != '_') {
      slug += '_';
    }
  }
  return slug.empty() ? "run" : slug;
}

std::string RunData::about(const std::string& key) const {
  for (const auto& [name, text] : configuration) {
    if (name == key) return text;
  }
  return {};
}

RunData load_run(const std::string& label, const std::filesystem::path& path) {
  const auto reader = recording::RecordingReader::isolated(path);
  if (reader.rows() == 0)
    throw UserError(path.string() + ": holds no row; record for at least half a second");
  RunData run;
  run.label = label;
  run.slug = slug_of(label);
  run.path = path;
  run.summary = recording::summarise(reader);
  run.configuration = reader.configuration();

  const Values target = reader.read("tip_target_w_nm", 2);
  const std::string surface = reader.configuration("surface_z_w_nm");
  run.surface_known = !surface.empty();
  run.surface_z_w_nm = run.surface_known ? std::strtod(surface.c_str(), nullptr) : 0.0;

  Values time = reader.read("time_s");
  const double start_s = time.front();
  run.time_s = shifted_scaled(std::move(time), start_s, 1.0);
  run.largest_step_s = hole_of(run.time_s);
  run.hand_z_mm = shifted_scaled(reader.read("hand_pos_h_m", 2), 0.0, 1e3);
  run.target_height_nm = shifted_scaled(target, run.surface_z_w_nm, 1.0);
  run.tip_height_nm = shifted_scaled(reader.read("tip_pos_w_nm", 2), run.surface_z_w_nm, 1.0);
  const Values x = reader.read("tip_target_w_nm", 0);
  const Values y = reader.read("tip_target_w_nm", 1);
  run.lateral_nm.resize(x.size());
  for (std::size_t i = 0; i < x.size(); ++i)
    run.lateral_nm[i] = std::hypot(x[i] - x.front(), y[i] - y.front());
  run.tip_force_nn = reader.read("force_w_nn", 2);
  run.scaled_force_n = reader.read("hand_force_scaled_h_n", 2);
  run.applied_force_n = reader.read("hand_force_applied_h_n", 2);
  run.energy_mj = shifted_scaled(reader.read("energy_j"), 0.0, 1e3);
  run.damper_n_s_m = reader.read("damper_n_s_m");
  run.slave_energy_aj = reader.read("slave_energy_in_aj");
  const Values out = reader.read("slave_energy_out_aj");
  for (std::size_t i = 0; i < out.size(); ++i) run.slave_energy_aj[i] -= out[i];

  const Values sequence = reader.read("reply_sequence");
  const Values rtt = reader.read("rtt_us");
  for (std::size_t i = 0; i < sequence.size() && !(sequence[i] > 0); ++i) {
    run.tip_height_nm[i] = run.tip_force_nn[i] = std::numeric_limits<double>::quiet_NaN();
  }
  for (std::size_t i = 1; i < rtt.size(); ++i) {
    if (sequence[i] != sequence[i - 1] && rtt[i] > 0) run.rtt_us.push_back(rtt[i]);
  }

  const Values faults = reader.read("station_faults");
  const Values flags = reader.read("limit_flags");
  // Stopped for good: a fault and no force, to the last row.
  for (std::size_t i = flags.size(); i > 0; --i) {
    if (faults[i - 1] == 0 || (static_cast<std::uint32_t>(flags[i - 1]) & recording::kLimitStop) == 0) break;
    run.stopped_s = run.time_s[i - 1];
    run.stop_reason = fault_name(run.about("station_fault_names"), static_cast<unsigned>(faults[i - 1]));
  }

  run.segments = recording::find_curve_segments(run.target_height_nm, run.lateral_nm,
                                                recording::segment_threshold_nm(run.target_height_nm));
  run.contacts = find_contacts(run.time_s, reader.read("contact_state"));
  return run;
}

}  // namespace telenano::studies

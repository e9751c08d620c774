#include "tests/studies/zwidth/paper_study.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <set>

#include "telenano/common/base/error.h"
#include "telenano/common/config/print.h"
#include "tests/studies/zwidth/on_all_cores.h"
#include "tests/studies/zwidth/sampled_loop.h"

namespace telenano::studies {
namespace {

constexpr double kCrank_m = 0.15;
constexpr double kMass_kg = 2.0;
constexpr double kDampingOut_n_s_m = 2.0;
constexpr double kDampingIn_n_s_m = 20.0;
constexpr double kFilter_hz = 30.0;
constexpr double kForceBits = 12;
constexpr int kRowsEach = 8;

/// Beyond this virtual damping some heavy hand drives up even the softest wall.
double largest_damping(const ZWidthOptions& options) {
  const auto some_stable = [&](double b) {
    control::VirtualDamper damper;
    damper.damping_n_s_m = b;
    if (options.filter_hz > 0) damper.filter_s = 1.0 / (2.0 * M_PI * options.filter_hz);
    return control::heavy_hand_stiffness(options.display, damper) > 0;
  };
  double low = 0;
  double high = options.display.damping_n_s_m;
  while (some_stable(high)) high *= 2;
  while (high - low > 1e-3 * high) {
    const double middle = 0.5 * (low + high);
    (some_stable(middle) ? low : high) = middle;
  }
  return low;
}

}  // namespace

std::string PaperConfiguration::name() const {
  return fmt::format("{}-{}Hz-{}-{}", damper ? "damper" : "bare", fast ? 1000 : 100, fine ? 900000 : 8000,
                     filtered ? "filtered" : "unfiltered");
}

ZWidthOptions PaperConfiguration::options() const {
  ZWidthOptions options;
  options.display = {damper ? kDampingIn_n_s_m : kDampingOut_n_s_m, kMass_kg, fast ? 1e-3 : 1e-2};
  options.filter_hz = filtered ? kFilter_hz : 0.0;
  options.encoder_counts_per_m = (fine ? 900000 : 8000) / (2.0 * M_PI * kCrank_m);
  options.force_bits = kForceBits;
  return options;
}

double PaperConfiguration::velocity_resolution_m_s() const {
  const ZWidthOptions o = options();
  const double tau = o.filter_hz > 0 ? 1.0 / (2.0 * M_PI * o.filter_hz) : 0.0;
  return 1.0 / o.encoder_counts_per_m / (o.display.period_s + tau);
}

std::vector<PaperConfiguration> paper_configurations() {
  std::vector<PaperConfiguration> all;
  for (const bool damper : {true, false})
    for (const bool fast : {true, false})
      for (const bool fine : {true, false})
        for (const bool filtered : {true, false}) all.push_back({damper, fast, fine, filtered});
  return all;
}

void run_paper_study(const std::string& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  const std::string path = (std::filesystem::path(folder) / "zwidth.csv").string();
  const std::string header = std::string("configuration,row,") + kZWidthHeader;
  std::set<std::string> done;
  {
    std::ifstream in(path);
    std::string line;
    while (std::getline(in, line)) {
      const auto comma = line.find(',', line.find(',') + 1);
      // The last line may have been cut: it counts only when whole.
      if (comma != std::string::npos && !in.eof() && line != header) done.insert(line.substr(0, comma));
    }
  }
  std::FILE* const out = std::fopen(path.c_str(), done.empty() ? "w" : "a");
  if (out == nullptr) throw UserError(fmt::format("zwidth: --out: cannot write {}", path));
  if (done.empty()) fmt::print(out, "{}\n", header);

  struct Job {
    const PaperConfiguration* configuration;
    int row;
    double damping;
  };
  const std::vector<PaperConfiguration> configurations = paper_configurations();
  std::vector<Job> jobs;
  for (const PaperConfiguration& c : configurations) {
    // The hands of the simulation are lighter, and hold out a little longer.
    const double most = 1.2 * largest_damping(c.options());
    for (int row = 0; row < kRowsEach; ++row) {
      if (done.count(fmt::format("{},{}", c.name(), row)) != 0) continue;
      jobs.push_back({&c, row, most * row / (kRowsEach - 1)});
    }
  }
  std::mutex mutex;
  std::size_t finished = 0;
  on_all_cores(jobs.size(), [&](std::size_t i) {
    const Job& job = jobs[i];
    const ZWidthRow row = zwidth_row(job.configuration->options(), job.damping);
    const std::lock_guard lock(mutex);
    config::print(out, "{},{},{}\n", job.configuration->name(), job.row, csv(row));
    std::fflush(out);
    ++finished;
    if (finished % 16 == 0 || finished == jobs.size()) {
      config::print(stderr, "zwidth: {} of {} rows\n", finished, jobs.size());
    }
  });
  const bool good = std::ferror(out) == 0;
  if (std::fclose(out) != 0 || !good) throw RunError(path + ": cannot be written");
}

std::vector<PaperRow> read_paper_study(const std::string& folder) {
  const std::string path = (std::filesystem::path(folder) / "zwidth.csv").string();
  std::ifstream in(path);
  if (!in) throw UserError(fmt::format("zwidth: cannot read {}", path));
  const std::vector<PaperConfiguration> configurations = paper_configurations();
  std::vector<PaperRow> rows;
  std::string line;
  std::getline(in, line);
  while (std::getline(in, line)) {
    const std::size_t first = line.find(',');
    const std::size_t second = line.find(',', first + 1);
    const auto known = std::find_if(configurations.begin(), configurations.end(), [&](const auto& c) {
      return first != std::string::npos && c.name() == line.substr(0, first);
    });
    PaperRow row;
    if (known == configurations.end() || second == std::string::npos ||
        std::sscanf(line.c_str() + second, ",%lf,%lf,%lf,%lf,%lf,%lf", &row.values.virtual_damping_n_s_m,
                    &row.values.passive, &row.values.closed, &row.values.coupled, &row.values.free,
                    &row.values.simulated) != 6)
      throw UserError(fmt::format("zwidth: {}: not a row of this study: {}", path, line));
    row.configuration = *known;
    rows.push_back(row);
  }
  std::stable_sort(rows.begin(), rows.end(), [](const PaperRow& a, const PaperRow& b) {
    return a.values.virtual_damping_n_s_m < b.values.virtual_damping_n_s_m;
  });
  return rows;
}

}  // namespace telenano::studies

#include "tests/studies/zwidth/zwidth_study.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "telenano/common/base/error.h"
#include "tests/studies/zwidth/on_all_cores.h"
#include "tests/studies/zwidth/wall_simulation.h"

namespace telenano::studies {
namespace {

constexpr double kForceRange_n = 40.0;  // ±20 N, what the bits of the force command divide

void require(bool good, const char* flag, double value, const char* expected) {
  if (!good)
    throw UserError(fmt::format("zwidth: {}: {:g} is out of range; expected {}", flag, value, expected));
}

WallPlant wall_plant(const ZWidthOptions& options, double virtual_damping) {
  WallPlant plant;
  plant.display = options.display;
  plant.damper.damping_n_s_m = virtual_damping;
  plant.damper.delay_samples = options.delay_samples;
  if (options.filter_hz > 0) plant.damper.filter_s = 1.0 / (2.0 * M_PI * options.filter_hz);
  if (options.encoder_counts_per_m > 0) plant.encoder_quantum_m = 1.0 / options.encoder_counts_per_m;
  if (options.force_bits > 0) plant.force_quantum_n = kForceRange_n / std::exp2(options.force_bits);
  plant.coulomb_friction_n = options.coulomb_friction_n;
  plant.outside_damping_n_s_m = options.outside_damping_n_s_m;
  return plant;
}

}  // namespace

void ZWidthOptions::validate() const {
  const auto positive = [](double x) { return std::isfinite(x) && x > 0; };
  const auto not_negative = [](double x) { return std::isfinite(x) && x >= 0; };
  require(positive(display.damping_n_s_m), "--damping", display.damping_n_s_m, "> 0 N s/m");
  require(positive(display.period_s) && display.period_s <= 1, "--period-s", display.period_s, "(0, 1] s");
  require(positive(display.mass_kg), "--mass", display.mass_kg, "> 0 kg");
  require(not_negative(filter_hz), "--filter-hz", filter_hz, ">= 0 Hz (0: no filter)");
  require(delay_samples >= 0 && delay_samples <= 256, "--delay-samples", delay_samples,
          "0 to 256 (the eigenvalues of the loop take some minutes at the most)");
  require(not_negative(encoder_counts_per_m), "--encoder-counts-per-m", encoder_counts_per_m,
          ">= 0 counts/m (0: not quantised)");
  require(not_negative(coulomb_friction_n), "--coulomb-n", coulomb_friction_n, ">= 0 N");
  require(std::isfinite(outside_damping_n_s_m), "--outside-damping", outside_damping_n_s_m,
          "a finite number");
  if (virtual_damping_n_s_m.empty()) throw UserError("zwidth: --virtual-damping: the list is empty");
  for (const double b : virtual_damping_n_s_m) {
    require(std::isfinite(b), "--virtual-damping", b, "finite numbers");
  }
}

ZWidthRow zwidth_row(const ZWidthOptions& options, double virtual_damping) {
  const WallPlant plant = wall_plant(options, virtual_damping);
  ZWidthRow row;
  row.virtual_damping_n_s_m = virtual_damping;
  row.passive = control::passive_stiffness(plant.display, plant.damper);
  row.closed = control::passive_stiffness_closed(plant.display, plant.damper);
  row.free = stability_limit(plant.display, plant.damper, Hand{});
  const double heavy = control::heavy_hand_stiffness(plant.display, plant.damper);
  row.coupled = std::isnan(heavy) || std::isnan(row.free) ? std::nan("") : std::min(heavy, row.free);
  row.simulated = simulated_stiffness(plant);
  return row;
}

std::string csv(const ZWidthRow& row) {
  std::string text = fmt::format("{:.10g}", row.virtual_damping_n_s_m);
  for (const double value : {row.passive, row.closed, row.coupled, row.free, row.simulated}) {
    text += std::isnan(value) ? std::string(",nan") : fmt::format(",{:.10g}", value);
  }
  return text;
}

std::vector<ZWidthRow> run_zwidth(const ZWidthOptions& options, std::FILE* out) {
  options.validate();
  const std::vector<double>& list = options.virtual_damping_n_s_m;
  std::vector<ZWidthRow> rows(list.size());
  on_all_cores(list.size(), [&](std::size_t i) { rows[i] = zwidth_row(options, list[i]); });
  fmt::print(out, "{}\n", kZWidthHeader);
  for (const ZWidthRow& row : rows) fmt::print(out, "{}\n", csv(row));
  return rows;
}

}  // namespace telenano::studies

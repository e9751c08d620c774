#include "tests/studies/zwidth/scaling_study.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <span>

#include "tests/studies/report/gnuplot.h"
#include "tests/studies/zwidth/wall_simulation.h"

namespace telenano::studies {
namespace {

constexpr double kAllowed_m = 0.5e-3;  // swing that counts as grown; it starts at 0.1 mm

bool stable(const control::ScalingPlant& p, double mass_kg, double impedance,
            std::span<const PushingHand> hands) {
  WallPlant plant;
  plant.display = {p.device_damping_n_s_m, mass_kg, p.period_s};
  // The adaptive damper is one more virtual damper, inside the wall and out.
  plant.damper.damping_n_s_m = impedance * p.coupling_damping_n_s_m + p.adaptive_damping_n_s_m;
  plant.outside_damping_n_s_m = p.adaptive_damping_n_s_m;
  plant.damper.delay_samples = p.delay_samples;
  return std::all_of(hands.begin(), hands.end(), [&](const PushingHand& hand) {
    return simulate_wall(plant, impedance * p.coupling_stiffness_n_m, hand).peak_to_peak_m <= kAllowed_m;
  });
}

double largest(const control::ScalingPlant& p, double mass_kg, std::span<const PushingHand> hands) {
  const double unit = 2 * p.device_damping_n_s_m / (p.period_s * p.coupling_stiffness_n_m);
  double low = 1e-3 * unit;
  if (!stable(p, mass_kg, low, hands)) return std::nan("");
  while (low < 1e3 * unit && stable(p, mass_kg, 1.2 * low, hands)) low *= 1.2;
  double high = 1.2 * low;
  while (high > 1.01 * low) {
    const double middle = std::sqrt(low * high);
    (stable(p, mass_kg, middle, hands) ? low : high) = middle;
  }
  return low;
}

std::string number(double value) {
  return std::isnan(value) ? "nan" : fmt::format("{:.8g}", value);
}

}  // namespace

SimulatedImpedance simulated_impedance(const control::ScalingPlant& plant, double mass_kg) {
  SimulatedImpedance result{std::nan(""), std::nan("")};
  if (plant.delay_samples > 0 && plant.adaptive_damping_n_s_m != 0) return result;
  if (!(plant.coupling_stiffness_n_m > 0)) return result;
  const std::vector<PushingHand> hands = trying_hands({plant.device_damping_n_s_m, mass_kg, plant.period_s});
  std::vector<PushingHand> free;
  std::copy_if(hands.begin(), hands.end(), std::back_inserter(free),
               [](const PushingHand& h) { return h.arm.mass_kg == 0; });
  result.free_device = largest(plant, mass_kg, free);
  result.worst_hand = largest(plant, mass_kg, hands);
  return result;
}

ScalingRegion scaling_region(const control::ScalingPlant& plant, double mass_kg, double device_force_scale) {
  return {plant,
          mass_kg,
          device_force_scale,
          control::llewellyn_impedance_bound(plant),
          std::max(0.0, control::exact_impedance_bound(plant)),
          simulated_impedance(plant, mass_kg)};
}

Figure draw_scaling_region(const ScalingRegion& r, const std::string& id, const FigureFolder& folder) {
  std::string csv =
      "# block 0: velocity_scale,force_scale_llewellyn,force_scale_sampled,force_scale_device,"
      "force_scale_simulated_free,force_scale_simulated_hand; block 1: the same over "
      "coupling_damping/(k_c T), as shown stiffness alpha_v alpha_F k_c in N/m\n";
  for (int i = 0; i <= 40; ++i) {
    const double scale = std::pow(10.0, -8 + i * 0.1);
    csv += fmt::format("{:.8g},{},{},{:.8g},{},{}\n", scale, number(r.published / scale),
                       number(r.exact / scale), r.device_force_scale, number(r.simulated.free_device / scale),
                       number(r.simulated.worst_hand / scale));
  }
  csv += "\n\n";
  const double k_c = r.plant.coupling_stiffness_n_m;
  for (int i = 0; i <= 12; ++i) {
    control::ScalingPlant p = r.plant;
    const double ratio = 0.125 * i;
    p.coupling_damping_n_s_m = ratio * k_c * p.period_s;
    const SimulatedImpedance s = simulated_impedance(p, r.mass_kg);
    csv += fmt::format("{:.8g},{},{},nan,{},{}\n", ratio, number(k_c * control::llewellyn_impedance_bound(p)),
                       number(k_c * std::max(0.0, control::exact_impedance_bound(p))),
                       number(k_c * s.free_device), number(k_c * s.worst_hand));
  }
  folder.write(id + ".csv", csv);

  const control::ScalingPlant& p = r.plant;
  const std::string device = fmt::format(
      "b = {:g} N s/m, m = {:g} kg, T = {:g} ms, coupling {:.4g} N/m and {:g} N s/m, γ = {:g} N s/m, {} "
      "samples of delay",
      p.device_damping_n_s_m, r.mass_kg, 1e3 * p.period_s, k_c, p.coupling_damping_n_s_m,
      p.adaptive_damping_n_s_m, p.delay_samples);
  Figure figure{
      id, "Region of the force scaling factor",
      fmt::format(
          "{}. Shape and form agree with KS: below Llewellyn's curve (α_F ∝ 1/α_v) and below the device's "
          "limit ε f̂_a/f̂_e = {:.3g}. The size does not: Llewellyn's criterion on the hybrid matrix takes "
          "velocity and force at the samples and allows α_v α_F = {:.4g}; a device that holds its force "
          "between samples shows {:.4g} passively (exact, any discrete-passive environment), {:.2g} times "
          "less. In the time domain on a rigid environment the free device begins to swing at {:.4g}, the "
          "worst of the simulated hands at {:.4g}: both between the two bounds, so the published region "
          "holds unstable points. (α_v drops out of the loop: one search, shown at several α_v.) With "
          "damping in the coupling (right) hands of masses and springs alone stay above the exact bound: "
          "passivity is sufficient, not necessary.",
          device, r.device_force_scale, r.published, r.exact, r.published / r.exact, r.simulated.free_device,
          r.simulated.worst_hand),
      ""};
  std::string script = "set multiplot\nset logscale xy\nset format '10^{%T}'\n";
  script +=
      "set lmargin at screen 0.08\nset rmargin at screen 0.48\nset tmargin at screen 0.93\nset bmargin at "
      "screen 0.13\nset xlabel 'velocity scale α_v' noenhanced\nset ylabel 'force scale α_F' noenhanced "
      "offset 1,0\nset key top right Right noreverse samplen 2 spacing 1\n";
  script += fmt::format("set xrange [1e-8:1e-4]\nset yrange [{:.3g}:{:.3g}]\n", r.exact / 1e-4 / 10,
                        10 * r.published / 1e-8);
  script += fmt::format(
      "plot '{0}.csv' index 0 using 1:(column(3)<column(4)?column(3):column(4)) with filledcurves x1 fc rgb "
      "'#DCEBF5' title 'safe', '' index 0 using 1:2 lc rgb '{1}' lw 1.6 dt (6,4) title 'as published "
      "(Llewellyn)', '' index 0 using 1:3 lc rgb '{2}' lw 2 title 'exact, sampled data', '' index 0 using "
      "1:4 lc rgb '{3}' lw 1.6 title 'device limit', '' index 0 using 1:5 every 5 with points pt 8 ps 1 lc "
      "rgb '{1}' title 'free device swings from here', '' index 0 using 1:6 every 5::2 with points pt 6 ps 1 "
      "lc rgb '{4}' title 'worst hand swings from here'\n",
      id, kRed, kBlue, kInk, kPurple);
  script +=
      "unset logscale x\nset format x '%g'\nset lmargin at screen 0.6\nset rmargin at screen 0.98\nset "
      "xrange [0:1.5]\nset yrange [10:1e6]\nset xlabel 'damping of the coupling b_c/(k_c T)' noenhanced\nset "
      "ylabel 'shown stiffness α_v α_F k_c (N/m)' noenhanced offset -1.5,0\nset key bottom left Left "
      "reverse\n";
  script += fmt::format(
      "plot '{0}.csv' index 1 using 1:2 lc rgb '{1}' lw 1.6 dt (6,4) title 'as published (Llewellyn)', '' "
      "index 1 using 1:5 with linespoints pt 8 ps 0.8 lc rgb '{1}' title 'simulated, free device', '' index "
      "1 using 1:6 with linespoints pt 6 ps 0.8 lc rgb '{3}' title 'simulated, worst hand', '' index 1 using "
      "1:3 lc rgb '{2}' lw 2 title 'exact, sampled data'\n",
      id, kRed, kBlue, kPurple);
  folder.draw(figure, 1100, 480, script);
  return figure;
}

Figure draw_transmitted_impedance(const ScalingRegion& r, double velocity_scale, const std::string& id,
                                  const FigureFolder& folder) {
  using Complex = std::complex<double>;
  const control::ScalingPlant& p = r.plant;
  const double case_one = 1;                   // α_F = 1/α_v
  const double case_two = 1 / velocity_scale;  // α_F = 1/α_v²
  const double factors[] = {0, case_one, 0.1 * r.exact, r.exact, r.published, case_two};
  std::string csv =
      "# frequency_hz,z_min,z_max of alpha_v alpha_F = 1 (case I), a tenth of the exact bound, the exact "
      "bound, the published bound, 1/alpha_v (case II), N s/m\n";
  for (int i = 0; i <= 120; ++i) {
    const double frequency = 0.5 / p.period_s * std::pow(10.0, -3.5 + 3.5 * i / 120.0) * 0.999;
    const Complex z = std::polar(1.0, 2 * M_PI * frequency * p.period_s);
    const Complex hold = 0.5 * (z + 1.0) / z;
    const Complex device = 2 * r.mass_kg / p.period_s * (z - 1.0) / (z + 1.0) + p.device_damping_n_s_m;
    const Complex coupling = p.coupling_damping_n_s_m + p.coupling_stiffness_n_m * p.period_s * z / (z - 1.0);
    csv += fmt::format("{:.6g}", frequency);
    for (const double factor : factors)
      csv += fmt::format(",{:.6g}",
                         std::abs(device + p.adaptive_damping_n_s_m * hold + factor * coupling * hold));
    csv += "\n";
  }
  folder.write(id + ".csv", csv);
  Figure figure{
      id, "Z-width with the force scaling factor",
      fmt::format(
          "Least and largest impedance that the hand feels (KS eqs. 9 and 10) at α_v = {:g}: device (m = "
          "{:g} "
          "kg, b = {:g} N s/m, T = {:g} ms) alone, and with a rigid environment behind a coupling of {:.4g} "
          "N/m. As in KS the Z-width is proportional to α_v α_F. KS's cases: I, α_F = 1/α_v = {:.3g} "
          "(high adhesion), shows the coupling's own stiffness, hardly more than the bare device; II, α_F = "
          "1/α_v² = {:.3g} (low adhesion), would show {:.3g} N/m, {:.3g} times what this device shows "
          "passively: no choice at this α_v. The paper's own parameters are not given, so values are not "
          "comparable.",
          velocity_scale, r.mass_kg, p.device_damping_n_s_m, 1e3 * p.period_s, p.coupling_stiffness_n_m,
          1 / velocity_scale, 1 / (velocity_scale * velocity_scale), case_two * p.coupling_stiffness_n_m,
          case_two / r.exact),
      ""};
  const std::string script = fmt::format(
      "set logscale xy\nset format '10^{{%T}}'\nset format x '%g'\nset lmargin at screen 0.11\nset rmargin "
      "at "
      "screen 0.68\nset tmargin at screen 0.95\nset bmargin at screen 0.14\nset xlabel 'frequency (Hz)'\nset "
      "ylabel '|Z| (N s/m)' offset -1.5,0\nset key at graph 1.03, graph 1 top left Left reverse samplen "
      "2\nset "
      "xrange [{:.3g}:{:.3g}]\nplot '{}.csv' using 1:7 lc rgb '{}' lw 1.6 dt (6,4) title 'case II, α_F = "
      "1/α_v²', '' using 1:6 lc rgb '{}' lw 1.6 title 'published bound', '' using 1:5 lc rgb '{}' lw 2.2 "
      "title 'exact bound', '' using 1:4 lc rgb '{}' lw 1.6 title 'a tenth of it', '' using 1:3 lc rgb "
      "'{}' lw 1.6 dt (6,4) title 'case I, α_F = 1/α_v', '' using 1:2 lc rgb '{}' lw 2 title 'least: device "
      "alone'\n",
      0.5 / p.period_s * std::pow(10.0, -3.5), 0.5 / p.period_s, id, kRed, kRed, kBlue, kPale, kGreen, kInk);
  folder.draw(figure, 1000, 440, script);
  return figure;
}

}  // namespace telenano::studies

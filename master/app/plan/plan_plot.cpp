#include "telenano/master/app/plan/plan_plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "telenano/common/plot/gnuplot.h"

namespace telenano::app {
namespace {

constexpr double kDecades = 1.5;  // of the velocity scale, each way from the recommended one
constexpr int kPoints = 61;

struct Curve {
  double impedance;  ///< α_v α_F on it
  const char* colour;
  const char* form;
  std::string title;
};

}  // namespace

void draw_plan(const control::ScalingPlanInput& input, const control::ScalingPlan& plan,
               const std::string& title, const std::string& file) {
  const double velocity = plan.scaling.velocity;
  const int loop = input.plant.delay_samples;
  const auto samples = [](double count) {
    return fmt::format("{:.4g} sample{}", count, count == 1 ? "" : "s");
  };
  std::vector<Curve> curves{
      {plan.published_force_scale * velocity, plot::kRed, "lw 1.6 dt (6,4)", "as published (Llewellyn)"},
      {plan.sampled_force_scale * velocity, plot::kPale, "lw 1.8", "exact, no delay"},
  };
  if (plan.binding_delay_samples > 0 && plan.binding_delay_samples != loop) {
    curves.push_back({plan.passive_force_scale * velocity, plot::kBlue, "lw 2.4",
                      fmt::format("exact, {} (binds {})", samples(plan.binding_delay_samples),
                                  control::method_name(input.method))});
  }
  if (loop > 0) {
    const bool binds = plan.binding_delay_samples == loop;
    curves.push_back({plan.delayed_force_scale * velocity, binds ? plot::kBlue : plot::kGrey,
                      binds ? "lw 2.4" : "lw 1.8", fmt::format("exact, {} of this link", samples(loop))});
  }
  // Where nothing is safe there is nothing to draw on a logarithmic axis.
  std::erase_if(curves, [](const Curve& curve) { return !(curve.impedance > 0); });

  std::string data = "$curves << EOD\n";
  for (int i = 0; i < kPoints; ++i) {
    const double x = velocity * std::pow(10.0, kDecades * (2.0 * i / (kPoints - 1) - 1));
    data += fmt::format("{:.6g},{:.6g},{:.6g},{:.6g},{:.6g}", x, plan.device_force_scale,
                        std::min(plan.device_force_scale, plan.passive_force_scale * velocity / x), 1 / x,
                        1 / (x * x));
    for (const Curve& curve : curves) data += fmt::format(",{:.6g}", curve.impedance / x);
    data += "\n";
  }
  data += "EOD\n";

  const double low_x = velocity * std::pow(10.0, -kDecades);
  const double high_x = velocity * std::pow(10.0, kDecades);
  double low = std::min(plan.device_force_scale, plan.case_one_force_scale);
  double high = std::max(plan.device_force_scale, plan.published_force_scale);
  if (plan.scaling.force > 0) low = std::min(low, plan.scaling.force);
  std::string script = data;
  script += fmt::format(
      "set title {} noenhanced offset 0,0.2 font ',13'\n"
      "set lmargin at screen 0.11\nset rmargin at screen 0.66\nset tmargin at screen 0.91\nset bmargin at "
      "screen 0.13\n"
      "set logscale xy\nset format '10^{{%T}}'\nset xrange [{:.6g}:{:.6g}]\nset yrange [{:.6g}:{:.6g}]\n"
      "set xlabel 'velocity scale α_v' noenhanced\nset ylabel 'force scale α_F' noenhanced offset 1,0\n"
      "set key at screen 0.68, screen 0.9 left top Left reverse samplen 2 spacing 1.3\n",
      plot::quoted(title), low_x, high_x, low / 30, high * 30);
  std::string what;
  const auto add = [&](const std::string& one) { what += (what.empty() ? "plot " : ", \\\n  ") + one; };
  if (plan.scaling.force > 0) {
    add(fmt::format("$curves using 1:3 with filledcurves x1 fc rgb '#DCEBF5' title {}",
                    plot::quoted(fmt::format("safe with {}", control::method_name(input.method)))));
  }
  int column = 6;
  for (const Curve& curve : curves) {
    add(fmt::format("$curves using 1:{} lc rgb '{}' {} title {}", column++, curve.colour, curve.form,
                    plot::quoted(curve.title)));
  }
  add(fmt::format("$curves using 1:2 lc rgb '{}' lw 1.6 title 'force of the device'", plot::kInk));
  add(fmt::format("$curves using 1:4 lc rgb '{}' lw 1.2 dt (2,3) title {}", plot::kGreen,
                  plot::quoted("KS case I, α_F = 1/α_v")));
  add(fmt::format("$curves using 1:5 lc rgb '{}' lw 1.2 dt (8,3,2,3) title {}", plot::kPurple,
                  plot::quoted("KS case II, α_F = 1/α_v²")));
  if (plan.scaling.force > 0) {
    add(
        fmt::format("'+' using ({:.8g}):({:.8g}) every ::::0 with points pt 7 ps 1.2 lc rgb '{}' title "
                    "'recommended'",
                    velocity, plan.scaling.force, plot::kInk));
  }
  plot::draw(file, 920, 480, script + what + "\n");
}

}  // namespace telenano::app

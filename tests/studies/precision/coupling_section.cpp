#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "telenano/nve_server/physics/law/tip_sample_law.h"
#include "tests/studies/coupling/coupling_study.h"
#include "tests/studies/precision/law_methods.h"
#include "tests/studies/precision/studies.h"

namespace telenano::studies {
namespace {

constexpr double kStiffness = 20;    // N/m: the shipped scenes' coupling
constexpr double kDamping = 0.02;    // N s/m: a millisecond with it
constexpr double kMotionHz = 20;     // a quick hand
constexpr double kDuration_s = 0.1;  // two periods
constexpr double kRadius_nm = 20;
constexpr double kPeak_nm = 6;
constexpr double kLeastOverlap = 0.05;  // u_delta

struct Material {
  const char* name;
  double e_gpa, gamma, nu;
};

physics::TipSampleParameters silicon_on(const Material& m) {
  physics::TipSampleParameters p;
  p.contact_modulus_gpa = 4.0 / 3.0 / ((1 - 0.27 * 0.27) / 160 + (1 - m.nu * m.nu) / m.e_gpa);
  p.work_of_adhesion_n_m = 2 * std::sqrt(0.2 * m.gamma);
  p.van_der_waals = false;
  return p;
}

/// Contact in nm and nN by the textbook formulas; a straight line below 0.05 u_delta, where no motion here
/// goes but bisections and schemes that blow up do: without it they would ask beyond the fold.
CouplingLaw contact_law(const Material& material, const physics::ContactScales& s) {
  return {material.name, [s, law = InContact(s.lambda)](double overlap) mutable {
            const double wanted = overlap / s.overlap_nm;
            const double inside = std::max(wanted, kLeastOverlap);
            const InContact::State state = law.at(inside);
            return LawPoint{(state.load + state.slope * (wanted - inside)) * s.force_nn,
                            state.slope * s.force_nn / s.overlap_nm};
          }};
}

/// The commanded end at the samples, height above the surface: 1 to 6 nm below it and back.
std::vector<double> motion(double dt_s) {
  std::vector<double> end;
  const int steps = static_cast<int>(std::lround(kDuration_s / dt_s));
  for (int i = 0; i <= steps; ++i)
    end.push_back(-0.5 * (kPeak_nm + 1) + 0.5 * (kPeak_nm - 1) * std::cos(2 * M_PI * kMotionHz * i * dt_s));
  return end;
}

/// One way to step; adding one is adding an entry to schemes().
struct Scheme {
  std::string family;
  std::string setting;
  bool is_default;
  std::function<std::vector<double>(const CouplingSetup&, const CouplingLaw&, const physics::TipSampleLaw&,
                                    const std::vector<double>&)>
      forces;
};

/// As the slave does it: the law resolved against the compliance 1/(k + b/dt), the end shifted by the damper.
std::vector<double> slave_forces(const CouplingSetup& setup, const CouplingLaw&,
                                 const physics::TipSampleLaw& law, const std::vector<double>& end) {
  const double b = setup.damping_n_s_m / setup.dt_s;
  const double total = setup.stiffness_n_m + b;
  physics::TipSampleState state;
  std::vector<double> forces{law.advance(-end[0], 1 / setup.stiffness_n_m, kRadius_nm, state).force_nn};
  double e = -forces[0] / setup.stiffness_n_m;
  for (std::size_t i = 1; i < end.size(); ++i) {
    const double force = law.advance(e * b / total - end[i], 1 / total, kRadius_nm, state).force_nn;
    e = (b * e - force) / total;
    forces.push_back(force);
  }
  return forces;
}

std::vector<Scheme> schemes() {
  const auto other = [](CouplingMethod method, int iterations) {
    return [=](CouplingSetup setup, const CouplingLaw& law, const physics::TipSampleLaw&,
               const std::vector<double>& end) {
      setup.method = method;
      setup.iterations = iterations;
      return coupling_history(setup, law, end);
    };
  };
  std::vector<Scheme> all{{"implicit, the slave's", "", true, slave_forces},
                          {"explicit", "", false, other(CouplingMethod::kExplicit, 1)},
                          {"semi-implicit", "", false, other(CouplingMethod::kSemiImplicit, 1)}};
  for (const int n : {1, 2, 3, 5})
    all.push_back(
        {fmt::format("implicit, {} Newton steps", n), "", false, other(CouplingMethod::kImplicit, n)});
  return all;
}

/// Largest stiffness of a linear contact against which `setup` is stable, by running it.
std::string stable_until(const CouplingSetup& setup, double theory) {
  const auto stable = [&](double stiffness) { return is_stable(setup, linear_law(stiffness), 10); };
  double low = 1e-3;
  double high = 1e6;
  if (stable(high)) return "above 1e6";
  if (!stable(low)) return "none";
  for (int i = 0; i < 24; ++i) {
    const double mid = std::sqrt(low * high);
    (stable(mid) ? low : high) = mid;
  }
  return fmt::format("{:.3g} ({:.3g})", low, theory);
}

/// Largest stiffness up to which the force stays within 1 % while the end is pressed and released.
std::string accurate_until(const CouplingSetup& setup) {
  const auto accurate = [&](double stiffness) {
    return coupling_row(setup, linear_law(stiffness), 10).error < 0.01;
  };
  // The error is not monotone: the first stiffness at which it is too large counts.
  double last = 0;
  for (double stiffness = 1e-2; stiffness < 2e6; stiffness *= 2) {
    if (!accurate(stiffness)) return last == 0 ? "none" : fmt::format("{:.2g}", last);
    last = stiffness;
  }
  return "above 1e6";
}

std::string limits_table(const Effort& effort) {
  std::string html =
      "<h3>Stable, and accurate to 1 %, until where</h3>\n<p>Largest stiffness of a linear contact (N/m) "
      "against which a disturbance dies out, found by running the scheme; in brackets the closed form, 2b/dt "
      "− k explicit and 2b/dt + k semi-implicit. Below it, the largest up to which the force stays within 1 "
      "% (root mean square) while 10 nm are pressed in within 20 samples and released again: faster the "
      "higher the rate, so that a damper tells most at high rates. Coupling 20 N/m.</p>\n<div "
      "class=\"scroll\"><table>\n<thead><tr><th>scheme</th><th>damping, N·s/m</th><th></th><th>100 "
      "Hz</th><th>1 kHz</th><th>4 kHz</th><th>10 kHz</th></tr></thead>\n<tbody>\n";
  struct Entry {
    const char* name;
    CouplingMethod method;
    double sign;  ///< of k in the closed form
  };
  for (const Entry& entry : {Entry{"explicit", CouplingMethod::kExplicit, -1},
                             Entry{"semi-implicit", CouplingMethod::kSemiImplicit, 1},
                             Entry{"implicit", CouplingMethod::kImplicit, 0}}) {
    for (const double damping : {0.0, 0.002, 0.02, 0.2}) {
      if (effort.quick && damping != 0.02) continue;
      if (entry.method == CouplingMethod::kExplicit && damping == 0) continue;  // not defined
      std::string stable, accurate;
      for (const double rate : {100.0, 1000.0, 4000.0, 10000.0}) {
        const CouplingSetup setup{entry.method, 1, kStiffness, damping, 1 / rate};
        stable += "<td>" + stable_until(setup, std::max(0.0, 2 * damping * rate + entry.sign * kStiffness)) +
                  "</td>";
        accurate += "<td>" + accurate_until(setup) + "</td>";
      }
      html += fmt::format(
          "<tr><th>{}</th><td>{:g}</td><td>stable</td>{}</tr>\n<tr><th></th><td></td><td>1 %</td>{}</tr>\n",
          entry.name, damping, stable, accurate);
    }
  }
  return html + "</tbody></table></div>\n";
}

}  // namespace

Section coupling_section(const Effort& effort, const FigureFolder& folder) {
  Section section;
  section.id = "coupling";
  section.title = "Virtual coupling against the contact";
  section.lead =
      "A spring of 20 N/m and a damper of 0.02 N·s/m between the commanded end and the tip; the end moves "
      "between 1 and 6 nm below the surface at 20 Hz. Largest error of the force over its largest value, "
      "against Runge–Kutta 4 in steps far shorter than the fastest time constant, with the textbook form of "
      "Maugis–Dugdale (the slave's scheme runs on the product's law). The settings of one scheme are the "
      "sample rates 100 Hz to 10 kHz.";
  section.choice =
      "Default: implicit, the law solved whole against the coupling's compliance. It is stable at any "
      "stiffness "
      "of the contact and any rate, with no damper needed (the shipped scenes have none: then it is exact, a "
      "balance at every step). The explicit scheme needs 2b/dt above the sum of both stiffnesses, the "
      "semi-implicit one a contact softer than 2b/dt + k: on silicon oxide both blow up at every rate up to "
      "several kilohertz. Newton steps from the last state must be the more the further a sample moves "
      "(silicon "
      "oxide at 100 Hz: one fails, two err by a third), and know nothing of folds: across a snap-in they may "
      "end "
      "on an unstable root, which the law's bracketing and its memory of the branch exclude. (Times in the "
      "rows: "
      "the slave's runs on the product's law, the others on the textbook's; they compare among themselves.)";
  const Material materials[] = {{"silicon oxide, 20 nm tip", 70, 0.2, 0.27},
                                {"polystyrene, 20 nm tip", 2, 0.066, 0.4},
                                {"soft gel (E = 50 MPa), 20 nm tip", 0.05, 0.022, 0.5}};
  std::vector<double> rates{100, 300, 1000, 3000, 10000};
  if (effort.quick) rates = {100, 1000, 4000};
  std::vector<Line> lines;
  for (const Material& material : materials) {
    const physics::TipSampleLaw law(silicon_on(material));
    const CouplingLaw textbook = contact_law(material, law.scales(kRadius_nm));
    std::vector<std::vector<double>> references;
    for (const double rate : rates) {
      references.push_back(coupling_reference({CouplingMethod::kImplicit, 1, kStiffness, kDamping, 1 / rate},
                                              textbook, motion(1 / rate), 50));
    }
    for (const Scheme& scheme : schemes()) {
      Line line{material.name, scheme.family, {}, {}};
      for (std::size_t r = 0; r < rates.size(); ++r) {
        const CouplingSetup setup{CouplingMethod::kImplicit, 1, kStiffness, kDamping, 1 / rates[r]};
        const std::vector<double>& reference = references[r];
        const std::vector<double> end = motion(setup.dt_s);
        double most = 0;
        for (const double force : reference) most = std::max(most, std::fabs(force));
        const std::vector<double> forces = scheme.forces(setup, textbook, law, end);
        std::vector<double> errors;
        for (std::size_t i = 0; i < reference.size(); ++i)
          errors.push_back(std::fabs(forces[i] - reference[i]) / most);
        Row row{material.name,     scheme.family,     fmt::format("{:g} Hz", rates[r]),
                scheme.is_default, summarise(errors), {}};
        if (row.errors.failures > 0 || row.errors.largest > 1) {  // it has blown up, or says nothing
          row.errors.largest = HUGE_VAL;
          row.errors.failures = row.errors.points;
        } else {
          row.cost =
              measure([&] { (void)scheme.forces(setup, textbook, law, end); }, reference.size(), effort);
        }
        line.x.push_back(rates[r]);
        line.y.push_back(std::isfinite(row.errors.largest) ? row.errors.largest : NAN);
        section.rows.push_back(row);
      }
      lines.push_back(std::move(line));
    }
  }
  section.figures.push_back(log_line_figure(
      {"coupling", "Error against sample rate",
       "Where a scheme has no point it blew up, or was wrong by more than the force itself. At low rates "
       "spring and damper have come to rest within a sample and an implicit scheme has little left to get "
       "wrong; that is where the others fail. Lines that coincide: the slave's and those Newton iterations "
       "that have converged.",
       ""},
      lines, {"sample rate (Hz)", "largest relative error", "set xrange [80:12500]\n"}, folder));
  section.tables.push_back(limits_table(effort));
  std::string csv = coupling_csv_header() + "\n";
  const std::vector<CouplingLaw> laws{hertz_law(68.7, kRadius_nm), dmt_law(68.7, kRadius_nm, 0.4)};
  for (const CouplingRow& row : coupling_table(effort.pick(1, 4), laws)) csv += coupling_csv(row) + "\n";
  folder.write("coupling_limits.csv", csv);
  return section;
}

}  // namespace telenano::studies

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <stdexcept>

#include "nve_server/physics/tip_sample_law.h"
#include "tests/studies/precision/coupling_schemes.h"
#include "tests/studies/precision/law_methods.h"
#include "tests/studies/precision/studies.h"

namespace telenano::studies {
namespace {

constexpr double kStiffness = 20;    // N/m: the shipped scenes' coupling
constexpr double kDamping = 0.02;    // N s/m: a millisecond with it
constexpr double kMotionHz = 20;     // a quick hand
constexpr double kDuration_s = 0.1;  // two periods
constexpr double kPeak_nm = 6;

/// The commanded end: in contact throughout, from 1 nm to 6 nm and back.
double end_at(double t) {
  return 0.5 * (kPeak_nm + 1) - 0.5 * (kPeak_nm - 1) * std::cos(2 * M_PI * kMotionHz * t);
}

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

/// Contact in nm and nN by the textbook formulas.
ContactLaw contact_law(const physics::ContactScales& s) {
  return [s, law = InContact(s.lambda)](double overlap) mutable {
    const InContact::State state = law.at(overlap / s.overlap_nm);
    return ContactForce{state.load * s.force_nn, state.slope * s.force_nn / s.overlap_nm};
  };
}

/// Extension at rest under a resting end.
double balance(const ContactLaw& law, double end) {
  double e = 0;
  for (int i = 0; i < 200; ++i) {
    const ContactForce f = law(end - e);
    e -= (kStiffness * e - f.force) / (kStiffness + f.slope);
  }
  return e;
}

/// Force at the coarse times k·dt by Runge–Kutta 4 in steps that are small against b/(k + s) and dt:
/// b de/dt = F(u − e) − k e.
std::vector<double> reference_forces(const ContactLaw& law, double stiffest, double dt_s, int steps) {
  const double fine = std::min(dt_s, 0.02 * kDamping / (kStiffness + stiffest));
  const int inner = static_cast<int>(std::ceil(dt_s / fine));
  const double h = dt_s / inner;
  double e = balance(law, end_at(0));
  const auto rate = [&](double t, double at) {
    return (law(end_at(t) - at).force - kStiffness * at) / kDamping;
  };
  std::vector<double> forces;
  for (int k = 0; k < steps; ++k) {
    for (int i = 0; i < inner; ++i) {
      const double t = k * dt_s + i * h;
      const double a = rate(t, e);
      const double b = rate(t + 0.5 * h, e + 0.5 * h * a);
      const double c = rate(t + 0.5 * h, e + 0.5 * h * b);
      const double d = rate(t + h, e + h * c);
      e += h / 6 * (a + 2 * b + 2 * c + d);
    }
    // What the hand feels is the coupling's force.
    forces.push_back(law(end_at((k + 1) * dt_s) - e).force);
  }
  return forces;
}

/// The product's step: the law resolved against the compliance 1/(k + b/dt), the end shifted by the damper.
CouplingScheme product_scheme(const physics::TipSampleLaw& law,
                              std::shared_ptr<physics::TipSampleState> state) {
  return {"implicit, the slave's", "law solved whole", true,
          [&law, state](double e, double, double after, const CouplingStep& c, const ContactLaw&) {
            const double b = c.damping / c.dt_s;
            const double total = c.stiffness + b;
            const double force = law.advance(after - e * b / total, 1 / total, 20, *state).force_nn;
            return (b * e + force) / total;
          },
          [](const CouplingStep&) { return HUGE_VAL; }};
}

std::string stability_table() {
  std::string html =
      "<h3>Stable until where</h3>\n<p>Largest stiffness of a linear contact (N/m) against which a "
      "disturbance dies "
      "out, found by running the scheme; in brackets the closed form (2b/dt ∓ k). Coupling 20 N/m.</p>\n"
      "<div class=\"scroll\"><table>\n<thead><tr><th>scheme</th><th>damping, N·s/m</th><th>100 Hz</th><th>1 "
      "kHz</th><th>4 kHz</th><th>10 kHz</th></tr></thead>\n<tbody>\n";
  for (const CouplingScheme& scheme : coupling_schemes()) {
    if (scheme.setting != "1 force a step" && scheme.setting != "n = 1") continue;
    for (const double damping : {0.0, 0.002, 0.02, 0.2}) {
      html += fmt::format("<tr><th>{}</th><td>{:g}</td>", scheme.family, damping);
      for (const double rate : {100.0, 1000.0, 4000.0, 10000.0}) {
        const CouplingStep step{kStiffness, damping, 1 / rate};
        double low = 1e-3;
        double high = 1e6;
        if (is_stable(scheme, step, high)) {
          html += "<td>1e6 and more</td>";
        } else if (!is_stable(scheme, step, low)) {
          html += "<td>none</td>";
        } else {
          for (int i = 0; i < 40; ++i) {
            const double mid = std::sqrt(low * high);
            (is_stable(scheme, step, mid) ? low : high) = mid;
          }
          html += fmt::format("<td>{:.4g} ({:.4g})</td>", low, scheme.stable_until(step));
        }
      }
      html += "</tr>\n";
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
      "between 1 "
      "and 6 nm below the surface at 20 Hz. Largest error of the force over its largest value, against "
      "Runge–Kutta 4 "
      "in steps fifty times shorter than the fastest time constant, with the textbook form of "
      "Maugis–Dugdale. The "
      "settings of one scheme are the sample rates 100 Hz to 10 kHz.";
  section.choice =
      "Default: implicit, the law solved whole against the coupling's compliance. It is stable at any "
      "stiffness of "
      "the contact and any rate, with no damper needed (the shipped scenes have none: then it is exact, a "
      "balance "
      "at every step). The explicit scheme needs 2b/dt above the sum of both stiffnesses, the semi-implicit "
      "one a "
      "contact softer than 2b/dt + k: on silicon oxide both blow up at every rate up to several kilohertz. "
      "Newton's "
      "iterations from the last state find the same answer where a step is small, but wander off where it is "
      "large "
      "(silicon oxide at 100 Hz), and know nothing of folds: across a snap-in they may end on an unstable "
      "root, "
      "which the law's bracketing and its memory of the branch exclude.";
  const Material materials[] = {{"silicon oxide, 20 nm tip", 70, 0.2, 0.27},
                                {"polystyrene, 20 nm tip", 2, 0.066, 0.4},
                                {"soft gel (E = 50 MPa), 20 nm tip", 0.05, 0.022, 0.5}};
  for (const Material& material : materials) {
    const physics::TipSampleLaw law(silicon_on(material));
    const physics::ContactScales scales = law.scales(20);
    const ContactLaw exact = contact_law(scales);
    const double stiffest = exact(kPeak_nm).slope;
    const auto state = std::make_shared<physics::TipSampleState>();
    std::vector<CouplingScheme> schemes{product_scheme(law, state)};
    for (CouplingScheme& scheme : coupling_schemes()) {
      scheme.is_default = false;
      schemes.push_back(std::move(scheme));
    }
    std::vector<double> rates{100, 300, 1000, 3000, 10000};
    if (effort.quick) rates = {100, 1000, 4000};
    std::vector<std::vector<double>> references;
    for (const double rate : rates)
      references.push_back(reference_forces(exact, stiffest, 1 / rate, static_cast<int>(kDuration_s * rate)));
    for (const CouplingScheme& scheme : schemes) {
      for (std::size_t r = 0; r < rates.size(); ++r) {
        const CouplingStep step{kStiffness, kDamping, 1 / rates[r]};
        const std::vector<double>& reference = references[r];
        double most = 0;
        for (const double force : reference) most = std::max(most, std::fabs(force));
        const ContactLaw own = contact_law(scales);
        const double start = balance(own, end_at(0));
        std::vector<double> forces(reference.size());
        const auto run = [&] {
          *state = physics::TipSampleState{};
          law.advance(end_at(0), 1 / kStiffness, 20, *state);
          double e = start;
          for (std::size_t i = 0; i < reference.size(); ++i) {
            const double before = end_at(static_cast<double>(i) * step.dt_s);
            const double after = end_at(static_cast<double>(i + 1) * step.dt_s);
            const double next = scheme.next(e, before, after, step, own);
            forces[i] = step.stiffness * next + step.damping * (next - e) / step.dt_s;
            if (!(std::fabs(next) < 1e3)) {  // it has blown up: no more forces to ask for
              std::fill(forces.begin() + static_cast<std::ptrdiff_t>(i), forces.end(), NAN);
              return;
            }
            e = next;
          }
        };
        run();
        std::vector<double> errors;
        for (std::size_t i = 0; i < reference.size(); ++i)
          errors.push_back(std::fabs(forces[i] - reference[i]) / most);
        Row row{material.name,     scheme.family,     fmt::format("{:g} Hz, {}", rates[r], scheme.setting),
                scheme.is_default, summarise(errors), {}};
        const bool lost = row.errors.failures > 0 || row.errors.largest > 1;
        if (lost) {
          row.errors.largest = HUGE_VAL;
          row.errors.failures = row.errors.points;
        } else {
          row.cost = measure(run, reference.size(), effort);
        }
        section.rows.push_back(row);
      }
    }
  }
  // One line a scheme and n.
  std::vector<Line> lines;
  for (const Row& row : section.rows) {
    const auto comma = row.setting.find(" Hz, ");
    const std::string n = row.setting.substr(comma + 5);
    const std::string name = n.rfind("n = ", 0) == 0 ? "implicit, Newton " + n : row.family;
    if (lines.empty() || lines.back().panel != row.condition || lines.back().name != name)
      lines.push_back({row.condition, name, {}, {}});
    bool found = false;
    for (Line& line : lines) {
      if (line.panel != row.condition || line.name != name) continue;
      line.x.push_back(std::stod(row.setting));
      line.y.push_back(std::isfinite(row.errors.largest) ? row.errors.largest : NAN);
      found = true;
      break;
    }
    if (!found) throw std::logic_error("coupling: no line");
  }
  section.figures.push_back(log_line_figure(
      {"coupling", "Error against sample rate",
       "Where a scheme has no point it blew up. First order in the step, all of them: what differs is where "
       "they can "
       "be used at all.",
       ""},
      lines, {"sample rate (Hz)", "largest relative error", "set xrange [80:12500]\n"}, folder));
  section.tables.push_back(stability_table());
  return section;
}

}  // namespace telenano::studies

// What one balance costs as the scene is asked for more, and how well its account of energy closes.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>

#include "telenano/nve_server/physics/equilibrium/level_equilibrium.h"
#include "telenano/nve_server/physics/equilibrium/marked_potential.h"
#include "telenano/nve_server/physics/particle/particle_equilibrium.h"
#include "telenano/nve_server/physics/surface/flat_surface.h"
#include "tests/studies/precision/analytic_surface.h"
#include "tests/studies/precision/studies.h"
#include "tests/studies/report/page.h"
#include "tests/support/particle_grounds.h"

namespace telenano::studies {
namespace {

using physics::FrictionParameters;
using physics::LevelEquilibrium;
using physics::MaugisMethod;
using physics::SplineSurface;
using physics::TipSampleLaw;
using physics::TipSampleParameters;
using physics::TipSolution;

constexpr double kTipRadius_nm = 20;
constexpr double kParticleRadius_nm = 30;
constexpr double kDt_s = 1e-3;
constexpr double kSettleStep_nm = 0.5;
constexpr double kHardness_gpa = 0.25;  // of polystyrene, as deployed for lithography
const AnalyticSurface kWaves{4, 200};

/// The shipped scenes' springs: coupling 20 N/m, lever 40 N/m.
physics::Compliance springs() {
  physics::Compliance c = Mat3::Identity() / 20.0;
  c(2, 2) += 1.0 / 40.0;
  return c;
}

/// A silicon tip on polystyrene.
TipSampleParameters polystyrene() {
  TipSampleParameters p;
  p.contact_modulus_gpa = 4.0 / 3.0 / ((1 - 0.27 * 0.27) / 160 + (1 - 0.4 * 0.4) / 2);
  p.work_of_adhesion_n_m = 2 * std::sqrt(0.2 * 0.066);
  return p;
}

/// What is stepped; a new one for each repeat, since marks stay and particles move.
class Walker {
 public:
  virtual ~Walker() = default;
  virtual TipSolution step(const Vec3& free_end) = 0;
  /// Height of the ground under the path.
  virtual double ground_nm(double, double) const { return 0; }
};

class OnLevel final : public Walker {
 public:
  OnLevel(const TipSampleParameters& parameters, const std::optional<FrictionParameters>& friction)
      : equilibrium_(std::make_shared<TipSampleLaw>(parameters, kTipRadius_nm), kTipRadius_nm, friction) {}
  TipSolution step(const Vec3& free_end) override { return equilibrium_.advance(free_end, c_, state_); }

 private:
  LevelEquilibrium equilibrium_;
  physics::Compliance c_ = springs();
  physics::LevelState state_;
};

/// The waves as fields of the apex, and as heights.
struct Waves {
  physics::HeightGrid grid = kWaves.grid(160, 1);
  std::shared_ptr<const physics::ScanFields> fields = std::make_shared<physics::ScanFields>(
      grid, kTipRadius_nm,
      physics::softening_rule(kTipRadius_nm, polystyrene().work_of_adhesion_n_m,
                              0.75 * polystyrene().contact_modulus_gpa,
                              polystyrene().equilibrium_distance_nm));
  std::shared_ptr<const physics::BranchPotential> law =
      std::make_shared<physics::BranchPotential>(TipSampleLaw(polystyrene()), kTipRadius_nm);
  SplineSurface heights{grid};

  physics::PotentialEquilibrium equilibrium(const std::optional<FrictionParameters>& friction) const {
    return {fields, law, friction};
  }
};

class OnWaves final : public Walker {
 public:
  OnWaves(std::shared_ptr<const Waves> waves, const std::optional<FrictionParameters>& friction)
      : waves_(std::move(waves)), equilibrium_(waves_->equilibrium(friction)) {}
  TipSolution step(const Vec3& free_end) override { return equilibrium_.advance(free_end, c_, state_); }
  double ground_nm(double x, double y) const override { return kWaves.height_nm(x, y); }

 private:
  std::shared_ptr<const Waves> waves_;
  physics::PotentialEquilibrium equilibrium_;
  physics::Compliance c_ = springs();
  physics::PotentialState state_;
};

class Ploughing final : public Walker {
 public:
  explicit Ploughing(const Waves& waves)
      : sample_(*waves.fields, waves.heights, waves.equilibrium({}), {}, kHardness_gpa, 1.0) {}
  TipSolution step(const Vec3& free_end) override {
    const TipSolution s = sample_.advance(free_end, c_, state_);
    if (s.status == physics::SolveStatus::kOk) sample_.accept(s);
    return s;
  }
  double ground_nm(double x, double y) const override { return kWaves.height_nm(x, y); }

 private:
  physics::MarkedPotential sample_;
  physics::Compliance c_ = springs();
  physics::PotentialState state_;
};

class Pushing final : public Walker {
 public:
  explicit Pushing(bool frictionless)
      : equilibrium_(std::make_shared<physics::FlatSurface>(), parameters(frictionless),
                     support::level_ground(parameters(frictionless))),
        state_(rest()) {}
  TipSolution step(const Vec3& free_end) override {
    return equilibrium_.advance(free_end, c_, kDt_s, state_).tip;
  }

 private:
  static physics::ParticleParameters parameters(bool frictionless) {
    physics::ParticleParameters p;
    p.tip_radius_nm = kTipRadius_nm;
    p.particle_radius_nm = kParticleRadius_nm;
    p.tip_sample = p.tip_particle = p.particle_sample = polystyrene();
    p.tip_sample_friction = p.tip_particle_friction = p.particle_sample_friction =
        frictionless ? physics::ContactFriction{} : physics::ContactFriction{0.03, 0.4, 0.3};
    return p;
  }
  physics::ParticleState rest() const { return equilibrium_.place(60, 0); }

  physics::ParticleEquilibrium equilibrium_;
  physics::ParticleState state_;
  physics::Compliance c_ = springs();
};

/// There and back between two places of the free end, heights above the ground.
struct Path {
  const char* condition;
  Vec3 from, to;
};
const Path kFar{"held 10 to 20 nm above, flat", {0, 0, 20}, {0, 0, 10}};
const Path kPressed{"pressed 1 to 6 nm, flat", {0, 0, -1}, {0, 0, -6}};
const Path kJumps{"in and out, flat", {0, 0, 10}, {0, 0, -3}};
const Path kSlide{"sliding and pressing, flat", {0, 0, -3}, {20, 0, -4}};
const Path kWavesPath{"sliding, waves of 200 nm", {-30, 3, -3}, {30, 3, -3}};
const Path kPlough{"pressed hard and dragged, waves of 200 nm", {-20, 3, -15}, {20, 3, -15}};
const Path kPush{"pushing a particle, flat", {12, 0, 12}, {62, 0, 12}};

/// Adding a row is adding an entry.
struct Case {
  Path path;
  std::string family;
  bool is_default;
  std::function<std::unique_ptr<Walker>()> make;
};

std::vector<Case> cases() {
  const auto waves = std::make_shared<const Waves>();
  const auto on_level = [](const TipSampleParameters& p,
                           const std::optional<FrictionParameters>& friction = {}) {
    return [=] { return std::make_unique<OnLevel>(p, friction); };
  };
  const auto on_waves = [&](const std::optional<FrictionParameters>& friction = {}) {
    return [=] { return std::make_unique<OnWaves>(waves, friction); };
  };
  TipSampleParameters table = polystyrene();
  table.method = MaugisMethod::kTable;
  std::vector<std::pair<std::string, TipSampleParameters>> long_range;
  const auto with = [&](const char* name, const std::function<void(physics::LongRangeParameters&)>& set) {
    long_range.emplace_back(name, polystyrene());
    set(long_range.back().second.long_range);
  };
  with("+ retardation", [](auto& l) { l.retardation_nm = 100; });
  with("+ cone", [](auto& l) {
    l.cone_half_angle_deg = 15;
    l.cone_height_nm = 1000;
  });
  with("+ bias of 1 V", [](auto& l) { l.tip_bias_v = 1; });
  with("+ liquid bridge", [](auto& l) { l.capillary.humidity_percent = 50; });
  with("+ all of these", [](auto& l) {
    l.retardation_nm = 100;
    l.cone_half_angle_deg = 15;
    l.cone_height_nm = 1000;
    l.tip_bias_v = 1;
    l.capillary.humidity_percent = 50;
  });
  const FrictionParameters friction{0.03, 0.4, 0, 1};

  std::vector<Case> all;
  for (const Path& path : {kFar, kPressed, kJumps}) {
    all.push_back({path, "van der Waals, MD direct", true, on_level(polystyrene())});
    all.push_back({path, "van der Waals, MD table", false, on_level(table)});
    for (const auto& [name, p] : long_range) all.push_back({path, name, false, on_level(p)});
  }
  all.push_back({kSlide, "without friction", false, on_level(polystyrene())});
  all.push_back({kSlide, "with friction", true, on_level(polystyrene(), friction)});
  all.push_back({kWavesPath, "without friction", true, on_waves()});
  all.push_back({kWavesPath, "with friction", false, on_waves(friction)});
  all.push_back({kPlough, "without friction", true, on_waves()});
  all.push_back({kPlough, "leaving a mark", false, [=] { return std::make_unique<Ploughing>(*waves); }});
  all.push_back({kPush, "with friction", true, [] { return std::make_unique<Pushing>(false); }});
  all.push_back({kPush, "without friction", false, [] { return std::make_unique<Pushing>(true); }});
  return all;
}

std::vector<Vec3> points_of(const Path& path, double step_nm, const Walker& walker) {
  const int n = static_cast<int>(std::lround((path.to - path.from).norm() / step_nm));
  std::vector<Vec3> points;
  for (int i = 0; i <= 2 * n; ++i) {
    Vec3 p = path.from + (path.to - path.from) * (static_cast<double>(i <= n ? i : 2 * n - i) / n);
    p.z() += walker.ground_nm(p.x(), p.y());
    points.push_back(p);
  }
  return points;
}

double stored_aj(const TipSolution& s) {
  return s.potential_aj + s.friction_stored_aj + 0.5 * s.force_w_nn.dot(springs() * s.force_w_nn);
}

struct Counted {
  Row row;
  double iterations = 0;
  int most_iterations = 0;
};

// From above down to where the path begins; to the particle's side without touching it on the way.
TipSolution settle(Walker& walker, const Vec3& start) {
  TipSolution s;
  for (double up = 40; up > 0; up -= kSettleStep_nm) s = walker.step(start + Vec3(-up, 0, up));
  return walker.step(start);
}

Counted evaluate(const Case& one, double step_nm, const Effort& effort) {
  Counted result;
  result.row = {one.path.condition,
                one.family,
                fmt::format("steps of {:g} nm", step_nm),
                one.is_default && step_nm == 0.25,
                {},
                {}};
  Row& row = result.row;
  // The account against the work of the free end by the trapezium rule.
  {
    const auto walker = one.make();
    const std::vector<Vec3> points = points_of(one.path, step_nm, *walker);
    TipSolution before = settle(*walker, points[0]);
    double work = 0, through = 0, counted = 0, most = 0;
    int failures = 0;
    for (std::size_t i = 1; i < points.size(); ++i) {
      const TipSolution s = walker->step(points[i]);
      result.iterations += s.iterations;
      result.most_iterations = std::max(result.most_iterations, s.iterations);
      if (s.status != physics::SolveStatus::kOk) {
        ++failures;
        continue;
      }
      const double dw = -0.5 * (before.force_w_nn + s.force_w_nn).dot(points[i] - points[i - 1]);
      work += dw;
      through += std::fabs(dw);
      counted += stored_aj(s) - stored_aj(before) + s.dissipated_aj + s.friction_dissipated_aj;
      most = std::max(most, std::fabs(counted - work));
      before = s;
    }
    result.iterations /= static_cast<double>(points.size() - 1);
    row.errors.largest = row.errors.p99 = row.errors.median = most / through;
    row.errors.failures = failures;
    row.errors.points = static_cast<int>(points.size() - 1);
  }
  std::vector<double> ns;
  const int repeats = effort.pick(5, 60);
  for (int k = 0; k < repeats; ++k) {
    const auto made = std::chrono::steady_clock::now();
    const auto walker = one.make();
    const double setup = std::chrono::duration<double>(std::chrono::steady_clock::now() - made).count();
    row.setup_us = k == 0 ? 1e6 * setup : std::min(row.setup_us, 1e6 * setup);
    const std::vector<Vec3> points = points_of(one.path, step_nm, *walker);
    settle(*walker, points[0]);
    const auto begin = std::chrono::steady_clock::now();
    for (std::size_t i = 1; i < points.size(); ++i) walker->step(points[i]);
    ns.push_back(1e9 * std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count() /
                 static_cast<double>(points.size() - 1));
  }
  std::sort(ns.begin(), ns.end());
  row.cost = {ns[ns.size() / 2], ns[std::min(ns.size() - 1, ns.size() * 99 / 100)]};
  return result;
}

}  // namespace

Section step_section(const Effort& effort, const FigureFolder& folder) {
  Section section;
  section.id = "step";
  section.title = "One step of tip, springs and sample";
  section.lead =
      "A silicon tip of 20 nm on polystyrene, held by 20 N/m in series with a lever of 40 N/m, there and "
      "back "
      "along a path: the time of one balance as more is asked for, and how well the account closes. Error: "
      "greatest difference between energy counted (stored and lost) and work of the free end by the "
      "trapezium rule, of all work that went through the port. The rule is of second order, so that an "
      "error that falls sixteenfold from line point to line point is the rule's; one that stays is the "
      "account's. A jump within a step costs the rule one order; it is in the path \"in and out\".";
  section.choice =
      "Default: van der Waals and Maugis–Dugdale by the direct method; all else only where a scene asks for "
      "it. "
      "A balance is a small part of the 250 µs of a 4 kHz tick in every row but one, so that what a scene "
      "contains is a question of what is known about the sample, not of time. The exception is a mark that "
      "is being made: each step lowers the fields under the contact, and drags a tip on through a groove "
      "with walls. Long-range terms cost the more general walk along the curve. On waves the time goes into "
      "the fields of the apex and Newton's matrices, the law is a fifth.";
  std::string table =
      "<div class=\"scroll\"><table>\n<thead><tr><th>path</th><th>scene</th><th>step</th><th>Newton "
      "iterations, mean</th><th>most</th><th>without balance</th></tr></thead>\n<tbody>\n";
  for (const Case& one : cases()) {
    for (const double step_nm : {1.0, 0.25, 0.0625}) {
      const Counted counted = evaluate(one, step_nm, effort);
      section.rows.push_back(counted.row);
      table += fmt::format(
          "<tr><th>{}</th><td>{}</td><td>{}</td><td>{:.2f}</td><td>{}</td><td>{}</td></tr>\n",
          html_escaped(one.path.condition), html_escaped(one.family), html_escaped(counted.row.setting),
          counted.iterations, counted.most_iterations, counted.row.errors.failures);
    }
  }
  section.tables.push_back(table + "</tbody></table></div>\n");
  section.figures.push_back(work_precision_figure(
      {"step", "Cost of a step, and what is left open in the account",
       "A line for each scene: steps of 1, 0.25 and 0.0625 nm. Flat without friction the balance is scalar; "
       "elsewhere it iterates (table below). The ring marks what the shipped scenes do, at 0.25 nm a step "
       "(250 nm/s at 1 kHz).",
       ""},
      section.rows, "energy left open, relative", folder));
  return section;
}

}  // namespace telenano::studies

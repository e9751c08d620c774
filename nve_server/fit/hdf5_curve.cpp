#include <algorithm>
#include <cmath>

#include "telenano/nve_server/fit/curve_file.h"
#include "telenano/nve_server/fit/hdf5_tree.h"

namespace telenano::fit {
namespace {

/// afmformats names a curve by its number: "0", "1", …
std::optional<Hdf5Tree::Address> curve_group(const Hdf5Tree& tree, std::size_t number) {
  return tree.find(tree.root(), std::to_string(number));
}

struct Column {
  std::string name;
  Hdf5Tree::Address at = 0;
  std::string unit;
};

}  // namespace

std::size_t curves_in(std::string_view bytes) {
  if (!bytes.starts_with(kHdf5Begin)) return 1;
  const Hdf5Tree tree(bytes);
  if (!tree.error().empty()) return 1;
  const auto members = tree.members(tree.root());
  std::size_t count = 0;
  const auto there = [&](const std::string& name) {
    return std::any_of(members.begin(), members.end(), [&](const auto& m) { return m.name == name; });
  };
  while (count < members.size() && count < kCurvesMax && there(std::to_string(count))) ++count;
  return std::max<std::size_t>(count, 1);
}

RawCurve read_hdf5(std::string_view bytes, const ColumnChoice& columns) {
  RawCurve curve;
  const auto fail = [&](const std::string& why) {
    curve.error = why;
    return curve;
  };
  const Hdf5Tree tree(bytes);
  if (!tree.error().empty()) return fail(tree.error());
  const auto group = curve_group(tree, columns.number);
  if (!group) {
    if (columns.number > 0 && curve_group(tree, 0)) {
      return fail("has " + std::to_string(curves_in(bytes)) +
                  " curves, numbered from 0: there is no curve number " + std::to_string(columns.number));
    }
    return fail(
        "is HDF5 without a force curve of afmformats: expected a group \"0\" with columns like force and "
        "height (measured)");
  }
  std::vector<Column> all;
  for (const auto& member : tree.members(*group)) {
    const auto attributes = tree.attributes(member.at);
    const auto unit = attributes.find("unit");
    all.push_back(
        {member.name, member.at, unit == attributes.end() ? std::string() : unit->second.text.value_or("")});
    if (all.size() >= 64) break;
  }
  const auto find = [&](const std::string& asked, std::initializer_list<const char*> usual) -> const Column* {
    for (const Column& column : all)
      if (!asked.empty() && column.name == asked) return &column;
    for (const char* name : usual)
      for (const Column& column : all)
        if (asked.empty() && column.name == name) return &column;
    return nullptr;
  };
  const Column* z = find(columns.z, {"height (measured)", "height (piezo)", "height"});
  const Column* bend = find(columns.deflection, {"deflection", "force"});
  if (z == nullptr || bend == nullptr) {
    std::string names;
    for (const Column& column : all) names += (names.empty() ? "" : ", ") + column.name;
    return fail(std::string("has no column for the ") + (z == nullptr ? "height" : "deflection or force") +
                ": name it by " + (z == nullptr ? "--z-column" : "--deflection-column") + "; it has " +
                plain_line(names, 100));
  }
  if (z->unit != "m") return fail("has its height in '" + plain_line(z->unit, 20) + "', expected m");
  const bool force = bend->unit == "N";
  if (!force && bend->unit != "m" && bend->unit != "V") {
    return fail("has column " + plain_line(bend->name) + " in '" + plain_line(bend->unit, 20) +
                "', expected N, m or V");
  }
  const auto attributes = tree.attributes(*group);
  const auto positive = [&](std::string_view name, double to_unit) -> std::optional<double> {
    const auto found = attributes.find(name);
    if (found == attributes.end() || !found->second.number || !(*found->second.number > 0))
      return std::nullopt;
    return to_unit * *found->second.number;
  };
  curve.stiffness_n_m = positive("spring constant", 1.0);
  curve.invols_nm_v = positive("sensitivity", 1e9);
  std::vector<double> heights;
  std::vector<double> deflections;
  std::vector<double> ways;
  std::string why;
  for (const auto& [column, out] : {std::pair{z, &heights}, std::pair{bend, &deflections}})
    if (!tree.column(column->at, kPointsMax, *out, why))
      return fail("has a column " + plain_line(column->name) + " that " + why);
  if (heights.size() != deflections.size()) {
    return fail("has " + std::to_string(heights.size()) + " heights and " +
                std::to_string(deflections.size()) + " deflections");
  }
  // A file's force is its deflection times its lever's stiffness: with that it is what was measured again.
  double factor = 1e9;
  if (bend->unit == "V") {
    curve.unit = DeflectionUnit::kVolt;
    factor = 1.0;
  } else if (force && curve.stiffness_n_m) {
    factor = 1e9 / *curve.stiffness_n_m;
  } else if (force) {
    curve.unit = DeflectionUnit::kNanonewton;
  }
  for (double& value : heights) value *= 1e9;
  for (double& value : deflections) value *= factor;
  if (const Column* segment = find("", {"segment"})) {
    if (!tree.column(segment->at, kPointsMax, ways, why) || ways.size() != heights.size())
      return fail("has a column segment that " + (why.empty() ? "is of another length" : why));
    // 0 approach; then the retract, or a pause and the retract.
    const double last = ways.empty() ? 1.0 : std::max(1.0, *std::max_element(ways.begin(), ways.end()));
    for (std::size_t i = 0; i < ways.size(); ++i) {
      if (ways[i] != 0 && ways[i] != last) continue;
      RawSegment& way = ways[i] == 0 ? curve.approach : curve.retract;
      way.z_nm.push_back(heights[i]);
      way.deflection.push_back(deflections[i]);
    }
  } else {
    split_at_turn(heights, deflections, curve);
  }
  curve.what = "HDF5 of afmformats, " + plain_line(z->name) + " and " + plain_line(bend->name);
  check_curve(curve);
  return curve;
}

}  // namespace telenano::fit

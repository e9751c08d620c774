#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>

#include "telenano/nve_server/fit/curve_file.h"
#include "telenano/nve_server/fit/zip_member.h"

namespace telenano::fit {
namespace {

constexpr std::size_t kPropertiesMax = std::size_t{1} << 20;
constexpr int kChainMax = 16;

/// key=value lines (java.util.Properties, without its continuation lines, which these files do not have).
using Properties = std::map<std::string, std::string, std::less<>>;

Properties parse_properties(std::string_view text) {
  Properties all;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    std::string_view line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    const std::size_t equals = line.find('=');
    if (line.empty() || line.front() == '#' || equals == std::string_view::npos) continue;
    all.emplace(line.substr(0, equals), line.substr(equals + 1));
  }
  return all;
}

std::string text_of(const Properties& all, const std::string& key) {
  const auto found = all.find(key);
  return found == all.end() ? std::string() : found->second;
}

std::optional<double> number_of(const Properties& all, const std::string& key) {
  const std::string text = text_of(all, key);
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

struct Line {
  double offset = 0;
  double multiplier = 1;
  std::string unit;
};

std::optional<Line> line_at(const Properties& all, const std::string& prefix) {
  const auto offset = number_of(all, prefix + ".offset");
  const auto multiplier = number_of(all, prefix + ".multiplier");
  if (!offset || !multiplier || text_of(all, prefix + ".style") != "offsetmultiplier") return std::nullopt;
  return Line{*offset, *multiplier, text_of(all, prefix + ".unit.unit")};
}

/// From the stored integers to the conversion `slot`: unit empty if there is no such chain.
Line chain_to(const Properties& all, const std::string& channel, std::string slot) {
  const std::string set = "channel." + channel + ".conversion-set.";
  const std::string base = text_of(all, set + "conversions.base");
  std::vector<Line> lines;  // the last one first
  for (int i = 0; i < kChainMax && slot != base; ++i) {
    const std::string at = set + "conversion." + slot;
    const auto line = line_at(all, at + ".scaling");
    if (!line || text_of(all, at + ".defined") != "true") return {};
    lines.push_back(*line);
    slot = text_of(all, at + ".base-calibration-slot");
  }
  if (slot != base) return {};
  const auto encoder = line_at(all, "channel." + channel + ".data.encoder.scaling");
  if (!encoder) return {};
  Line total = *encoder;
  for (auto line = lines.rbegin(); line != lines.rend(); ++line)
    total = {line->offset + line->multiplier * total.offset, line->multiplier * total.multiplier, line->unit};
  return total;
}

struct Archive {
  ZipDirectory zip;
  const ZipMember* find(const std::string& name) const {
    for (const ZipMember& member : zip.members)
      if (member.name == name) return &member;
    return nullptr;
  }
};

std::string read_channel(const Archive& archive, const std::string& folder, const Properties& all,
                         const std::string& channel, const Line& line, double per_unit,
                         std::vector<double>& out) {
  const std::string at = "channel." + channel + ".data.";
  const std::string encoder = text_of(all, at + "encoder.type");
  const std::size_t width = encoder == "signedshort" ? 2 : encoder == "signedinteger" ? 4 : 0;
  if (width == 0 || text_of(all, at + "file.format") != "raw")
    return "has channel " + plain_line(channel) + " encoded in a way that is not supported (" +
           plain_line(encoder) + ")";
  const ZipMember* member = archive.find(folder + text_of(all, at + "file.name"));
  std::string data;
  if (member == nullptr || !unpack(*member, kPointsMax * width, data) || data.size() % width != 0)
    return "has no complete data of channel " + plain_line(channel);
  out.reserve(data.size() / width);
  for (std::size_t i = 0; i + width <= data.size(); i += width) {
    std::uint32_t bits = 0;
    for (std::size_t j = 0; j < width; ++j) bits = bits << 8 | static_cast<unsigned char>(data[i + j]);
    const auto value = width == 2 ? static_cast<double>(static_cast<std::int16_t>(bits))
                                  : static_cast<double>(static_cast<std::int32_t>(bits));
    out.push_back(per_unit * (line.offset + line.multiplier * value));
  }
  return {};
}

std::string read_segment(const Archive& archive, const std::string& folder, const Properties& all,
                         const ColumnChoice& columns, RawSegment& segment, RawCurve& curve) {
  const std::string deflection = columns.deflection.empty() ? "vDeflection" : columns.deflection;
  Line height;
  std::string z;
  std::vector<std::string> names{columns.z};
  if (columns.z.empty()) names = {"measuredHeight", "capacitiveSensorHeight", "strainGaugeHeight", "height"};
  for (const std::string& name : names) {
    const std::string set = "channel." + name + ".conversion-set.conversions.default";
    height = chain_to(all, name, text_of(all, set));
    z = name;
    if (height.unit == "m") break;
  }
  if (height.unit != "m")
    return "has no height in metres that can be read (newer files: make a table with columns like "
           "z_nm,deflection_nm)";
  Line bend = chain_to(all, deflection, "distance");
  const Line force = chain_to(all, deflection, "force");
  const bool in_metres = bend.unit == "m";
  if (!in_metres)
    bend =
        chain_to(all, deflection, text_of(all, "channel." + deflection + ".conversion-set.conversions.base"));
  if (bend.unit != (in_metres ? "m" : "V"))
    return "has no deflection " + plain_line(deflection) + " that can be read";
  curve.unit = in_metres ? DeflectionUnit::kNanometre : DeflectionUnit::kVolt;
  if (in_metres && force.unit == "N" && bend.multiplier != 0)
    curve.stiffness_n_m = force.multiplier / bend.multiplier;
  curve.what = "JPK, " + plain_line(z) + " and " + plain_line(deflection);
  std::string error = read_channel(archive, folder, all, z, height, 1e9, segment.z_nm);
  if (error.empty())
    error = read_channel(archive, folder, all, deflection, bend, in_metres ? 1e9 : 1.0, segment.deflection);
  return error;
}

}  // namespace

RawCurve read_jpk(std::string_view bytes, const ColumnChoice& columns) {
  RawCurve curve;
  Archive archive{read_zip(bytes)};
  curve.error = archive.zip.error;
  if (!curve.error.empty()) return curve;
  bool have_approach = false;
  bool have_retract = false;
  for (int i = 0; i < 1000 && !(have_approach && have_retract); ++i) {
    const std::string folder = "segments/" + std::to_string(i) + "/";
    const ZipMember* header = archive.find(folder + "segment-header.properties");
    if (header == nullptr) break;
    std::string text;
    if (!unpack(*header, kPropertiesMax, text)) {
      curve.error = "has a damaged header of segment " + std::to_string(i);
      return curve;
    }
    const Properties all = parse_properties(text);
    const std::string style = text_of(all, "force-segment-header.settings.style");
    const bool approach = style == "extend" && !have_approach;
    if (!approach && (style != "retract" || have_retract)) continue;
    (approach ? have_approach : have_retract) = true;
    curve.error =
        read_segment(archive, folder, all, columns, approach ? curve.approach : curve.retract, curve);
    if (!curve.error.empty()) return curve;
  }
  if (!have_approach || !have_retract) {
    curve.error =
        "is a zip archive without a JPK force curve: expected a segment that extends and one that retracts";
    return curve;
  }
  check_curve(curve);
  return curve;
}

}  // namespace telenano::fit

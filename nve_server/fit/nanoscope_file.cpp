#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <map>

#include "telenano/nve_server/fit/curve_file.h"

// What the text says is in Bruker's NanoScope user guides (version 8.10, appendix on file formats): sections begin
// with "\*", values that begin with "\@" are a hard scale in round brackets (V/LSB), a soft scale by name in square
// ones ("Sens. DeflSens"), and a value. That both halves of a channel begin at contact, and that a sample may take
// four bytes where "Bytes/pixel" says two, is what readers of these files found: hooke (driver picoforce), pyMFD,
// pyAF.

namespace telenano::fit {
namespace {

constexpr std::size_t kHeaderMax = std::size_t{1} << 20;
constexpr std::size_t kChannelsMax = 64;

using Section = std::map<std::string, std::string, std::less<>>;

struct Header {
  Section all;                    // keys of every section, the first one counts
  std::vector<Section> channels;  // "Ciao force image list"
  bool images = false;            // "Ciao image list": what was scanned, or a force volume
  bool whole = false;
};

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t' || text.back() == '\r'))
    text.remove_suffix(1);
  return text;
}

/// A key without its group: "@4:Z scale" is "@Z scale".
std::string plain_key(std::string_view key) {
  if (key.size() > 3 && key[0] == '@' && key[1] >= '0' && key[1] <= '9' && key[2] == ':')
    return "@" + std::string(key.substr(3));
  return std::string(key);
}

Header read_header(std::string_view bytes) {
  Header header;
  std::string_view text = bytes.substr(0, kHeaderMax);
  Section* channel = nullptr;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    std::string_view line = trimmed(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
    if (line.empty() || line.front() != '\\') {
      if (!line.empty() && line.front() == '\x1a') break;
      continue;
    }
    line.remove_prefix(1);
    if (line.starts_with("*")) {
      channel = nullptr;
      const std::string_view title = trimmed(line.substr(1));
      if (title == "File list end") {
        header.whole = true;
        break;
      }
      if (title == "Ciao image list") header.images = true;
      if (title == "Ciao force image list" && header.channels.size() < kChannelsMax)
        channel = &header.channels.emplace_back();
      continue;
    }
    // The colon after a group's number belongs to the key.
    const std::size_t grouped = line.size() > 3 && line[0] == '@' && line[2] == ':' ? 3 : 0;
    const std::size_t colon = line.find(':', grouped);
    if (colon == std::string_view::npos) continue;
    const std::string key = plain_key(line.substr(0, colon));
    const std::string value(trimmed(line.substr(colon + 1)));
    header.all.emplace(key, value);
    if (channel != nullptr) channel->emplace(key, value);
  }
  return header;
}

std::string text_of(const Section& section, std::string_view key) {
  const auto found = section.find(key);
  return found == section.end() ? std::string() : found->second;
}

std::optional<double> number_in(std::string_view text) {
  text = trimmed(text);
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  static_cast<void>(end);
  if (error != std::errc() || !std::isfinite(value)) return std::nullopt;
  return value;
}

std::optional<std::size_t> count_in(std::string_view text) {
  const auto value = number_in(text);
  if (!value || !(*value >= 0 && *value < 4e9) || *value != std::floor(*value)) return std::nullopt;
  return static_cast<std::size_t>(*value);
}

/// `V [Sens. DeflSens] (0.000375 V/LSB) 20.0 V`
struct Scale {
  std::string soft;
  std::optional<double> hard_v_lsb;
  std::optional<double> value;
};

Scale scale_of(const std::string& text) {
  Scale scale;
  std::string_view rest = text;
  const auto between = [&](char open, char close) -> std::string_view {
    const std::size_t begin = rest.find(open);
    const std::size_t end = begin == std::string_view::npos ? begin : rest.find(close, begin);
    if (end == std::string_view::npos) return {};
    const std::string_view found = rest.substr(begin + 1, end - begin - 1);
    rest.remove_prefix(end + 1);
    return found;
  };
  scale.soft = std::string(between('[', ']'));
  const std::string_view hard = between('(', ')');
  if (hard.find("V/LSB") != std::string_view::npos) scale.hard_v_lsb = number_in(hard);
  if (rest == std::string_view(text)) rest.remove_prefix(std::min<std::size_t>(rest.find(' '), rest.size()));
  scale.value = number_in(rest);
  return scale;
}

/// `V 51.2 nm/V`
std::optional<double> sensitivity_nm_v(const Header& header, const std::string& name) {
  const std::string text = text_of(header.all, "@" + name);
  if (name.empty() || !text.starts_with("V")) return std::nullopt;
  const auto value = number_in(std::string_view(text).substr(1));
  if (!value || !(*value > 0)) return std::nullopt;
  if (text.ends_with("nm/V")) return value;
  if (text.ends_with("um/V")) return 1e3 * *value;
  return std::nullopt;
}

/// `S [DeflectionError] "Deflection Error"`: both names, small, without blanks and dots.
std::pair<std::string, std::string> names_of(const Section& channel) {
  const std::string text = text_of(channel, "@Image Data");
  const auto small = [](std::string_view name) {
    std::string out;
    for (const char c : name) {
      if (c >= 'A' && c <= 'Z')
        out += static_cast<char>(c - 'A' + 'a');
      else if (c != ' ' && c != '.')
        out += c;
    }
    return out;
  };
  const auto between = [&](char open, char close) -> std::string_view {
    const std::size_t begin = text.find(open);
    const std::size_t end = begin == std::string::npos ? begin : text.find(close, begin + 1);
    if (end == std::string::npos) return {};
    return std::string_view(text).substr(begin + 1, end - begin - 1);
  };
  return {small(between('[', ']')), small(between('"', '"'))};
}

/// Both halves, each from contact outwards.
struct Halves {
  std::vector<double> first;
  std::vector<double> second;
};

/// One channel's numbers. Empty: good.
std::string read_halves(std::string_view bytes, const Section& channel, const std::string& name,
                        Halves& halves, double& lowest) {
  const auto offset = count_in(text_of(channel, "Data offset"));
  const auto length = count_in(text_of(channel, "Data length"));
  auto points = count_in(text_of(channel, "Samps/line"));
  const auto bytes_each = count_in(text_of(channel, "Bytes/pixel"));
  if (!points && length && bytes_each && *bytes_each > 0) points = *length / (2 * *bytes_each);
  if (!offset || !length || !points || *points < 1)
    return "does not say where channel " + plain_line(name) + " is: Data offset, Data length and Samps/line";
  if (*points > kPointsMax) return "has a channel of more than a million points";
  const std::size_t width = *length / (2 * *points);
  if (*length % (2 * *points) != 0 || (width != 2 && width != 4)) {
    return "has " + std::to_string(*length) + " bytes of channel " + plain_line(name) + " for twice " +
           std::to_string(*points) +
           " points: expected 2 or 4 bytes a point, as in a single force curve (not a force volume)";
  }
  if (*offset > bytes.size() || *length > bytes.size() - *offset)
    return "is cut off: channel " + plain_line(name) + " is incomplete";
  lowest = width == 2 ? -32768.0 : -2147483648.0;
  for (std::size_t i = 0; i < 2 * *points; ++i) {
    std::uint32_t bits = 0;
    for (std::size_t j = width; j-- > 0;)
      bits = bits << 8 | static_cast<unsigned char>(bytes[*offset + i * width + j]);
    const double value = width == 2 ? static_cast<double>(static_cast<std::int16_t>(bits))
                                    : static_cast<double>(static_cast<std::int32_t>(bits));
    (i < *points ? halves.first : halves.second).push_back(value);
  }
  return {};
}

}  // namespace

RawCurve read_nanoscope(std::string_view bytes, const ColumnChoice& columns) {
  RawCurve curve;
  const auto fail = [&](const std::string& why) {
    curve.error = why;
    return curve;
  };
  const Header header = read_header(bytes);
  if (!header.whole) return fail("is a NanoScope file that ends within its header");
  if (header.channels.empty()) {
    return fail(header.images ? "is a NanoScope image, expected a force curve (a scan: telenano-nve import)"
                              : "is a NanoScope file without a force curve");
  }
  const auto channel = [&](const std::string& asked,
                           std::initializer_list<const char*> usual) -> const Section* {
    std::string wanted;
    for (const char c : asked)
      if (c != ' ' && c != '.') wanted += c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
    for (const Section& section : header.channels) {
      const auto [id, label] = names_of(section);
      if (!wanted.empty() && (id == wanted || label == wanted)) return &section;
    }
    for (const char* name : usual) {
      for (const Section& section : header.channels) {
        const auto [id, label] = names_of(section);
        if (wanted.empty() && (id == name || label == name)) return &section;
      }
    }
    return nullptr;
  };
  const Section* bend = channel(columns.deflection, {"deflection", "deflectionerror", "tmdeflection"});
  const Section* z = channel(columns.z, {"zsensor", "heightsensor"});
  if (bend == nullptr || (z == nullptr && !columns.z.empty())) {
    std::string names;
    for (const Section& section : header.channels)
      names += (names.empty() ? "" : ", ") + names_of(section).second;
    return fail(std::string("has no channel for the ") + (bend == nullptr ? "deflection" : "height") +
                ": name it by " + (bend == nullptr ? "--deflection-column" : "--z-column") + "; it has " +
                plain_line(names, 100));
  }
  // Deflection.
  Halves deflection;
  double lowest = 0;
  curve.error = read_halves(bytes, *bend, names_of(*bend).second, deflection, lowest);
  if (!curve.error.empty()) return curve;
  const Scale bend_scale = scale_of(text_of(*bend, "@Z scale"));
  if (!bend_scale.hard_v_lsb || *bend_scale.hard_v_lsb == 0)
    return fail("does not say how many volts the deflection's numbers are: @4:Z scale with V/LSB");
  curve.unit = DeflectionUnit::kVolt;
  curve.invols_nm_v = sensitivity_nm_v(header, bend_scale.soft);
  std::string spring = text_of(*bend, "Spring Constant");
  if (spring.empty()) spring = text_of(*bend, "Spring constant");
  const auto stiffness = number_in(spring);
  if (stiffness && *stiffness > 0) curve.stiffness_n_m = stiffness;
  // Height: what a sensor measured, or the ramp that was asked for, both outwards from contact.
  Halves height;
  std::size_t points = deflection.first.size();
  if (z != nullptr) {
    double ignored = 0;
    curve.error = read_halves(bytes, *z, names_of(*z).second, height, ignored);
    if (!curve.error.empty()) return curve;
    if (height.first.size() != points) return fail("has channels of different length");
    const Scale scale = scale_of(text_of(*z, "@Z scale"));
    const auto sensitivity = sensitivity_nm_v(header, scale.soft);
    if (!scale.hard_v_lsb || !sensitivity)
      return fail("does not say how many nm the height's numbers are: @4:Z scale, and @" +
                  plain_line(scale.soft.empty() ? "Sens. ZsensSens" : scale.soft, 40) + " in nm/V");
    for (std::vector<double>* half : {&height.first, &height.second})
      for (double& value : *half) value *= *scale.hard_v_lsb * *sensitivity;
  } else {
    std::string ramp;
    for (const char* key : {"@Ramp size", "@Ramp Size"})
      if (ramp.empty()) ramp = text_of(*bend, key);
    for (const char* key : {"@Ramp size Zsweep", "@Ramp size", "@Ramp Size", "@Z scan size"})
      if (ramp.empty()) ramp = text_of(header.all, key);
    const Scale scale = scale_of(ramp);
    auto sensitivity = sensitivity_nm_v(header, scale.soft);
    if (!scale.value || !(*scale.value > 0) || !sensitivity)
      return fail("has no channel for the height and does not say the ramp's: @4:Ramp size, and @" +
                  plain_line(scale.soft.empty() ? "Sens. Zsens" : scale.soft, 40) + " in nm/V");
    const double step = *scale.value * *sensitivity / static_cast<double>(points);
    for (std::vector<double>* half : {&height.first, &height.second})
      for (std::size_t i = 0; i < points; ++i) half->push_back(step * static_cast<double>(i));
  }
  // An approach may begin late: what was not measured stands at its far end. "Samps/line: 512 480" says how much it
  // is (before version 9.40, where the second number is another), or it is the lowest number there is.
  const std::string samples = text_of(*bend, "Samps/line");
  const std::size_t blank = std::min(samples.find(' '), samples.size());
  const auto begun = count_in(std::string_view(samples).substr(blank));
  const bool old = text_of(header.all, "Version") < "0x09400000";
  const auto take = [&](const std::vector<double>& h, const std::vector<double>& d, bool approach,
                        RawSegment& way) {
    std::size_t n = d.size();
    if (approach && old && begun && *begun > 0) n = std::min(n, *begun);
    while (n > 0 && d[n - 1] == lowest) --n;
    for (std::size_t i = 0; i < n; ++i) {
      const std::size_t at = approach ? n - 1 - i : i;
      way.z_nm.push_back(h[at]);
      way.deflection.push_back(d[at] * *bend_scale.hard_v_lsb);
    }
  };
  take(height.first, deflection.first, true, curve.approach);
  take(height.second, deflection.second, false, curve.retract);
  curve.what = "NanoScope " + plain_line(text_of(header.all, "Version"), 12) + ", " +
               (z == nullptr ? "ramp" : plain_line(names_of(*z).second)) + " and " +
               plain_line(names_of(*bend).second);
  check_curve(curve);
  return curve;
}

}  // namespace telenano::fit

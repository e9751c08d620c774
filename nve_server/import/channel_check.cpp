#include "telenano/nve_server/import/channel_check.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>
#include <sstream>
#include <vector>

namespace telenano::import {
namespace {

bool is_small(char c) {
  return c >= 'a' && c <= 'z';
}
bool is_large(char c) {
  return c >= 'A' && c <= 'Z';
}

/// In small letters; "HeightSensor" and "ZSensor" are two.
std::vector<std::string> words_of(std::string_view title) {
  std::vector<std::string> words(1);
  for (std::size_t i = 0; i < title.size(); ++i) {
    const char c = title[i];
    const bool begins = is_large(c) && i > 0 &&
                        (is_small(title[i - 1]) ||
                         (is_large(title[i - 1]) && i + 1 < title.size() && is_small(title[i + 1])));
    if (begins || !(is_small(c) || is_large(c))) words.emplace_back();
    if (is_large(c)) words.back() += static_cast<char>(c - 'A' + 'a');
    if (is_small(c)) words.back() += c;
  }
  return words;
}

/// Of a line "    X Amplitude: 20 µm" in the header.
struct Amplitude {
  bool stated = false;
  std::optional<double> metres;
};

Amplitude amplitude_of(std::string_view header, std::string_view name) {
  Amplitude amplitude;
  while (!header.empty()) {
    const std::size_t end = std::min(header.find('\n'), header.size());
    std::string_view line = header.substr(0, end);
    header.remove_prefix(std::min(end + 1, header.size()));
    line.remove_prefix(std::min(line.find_first_not_of(" \t"), line.size()));
    if (line.starts_with("[Header end]")) break;
    if (!line.starts_with(name) || line.substr(name.size(), 1) != ":") continue;
    amplitude.stated = true;
    std::string text(line.substr(name.size() + 1));
    text.erase(0, std::min(text.find_first_not_of(" \t"), text.size()));
    std::replace(text.begin(), text.end(), ',', '.');
    double value = 0;
    const auto [rest, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc()) break;
    std::string unit(rest, static_cast<std::size_t>(text.data() + text.size() - rest));
    std::erase_if(unit, [](char c) { return c == ' ' || c == '\t' || c == '\r'; });
    for (const auto& [written, factor] :
         {std::pair("m", 1.0), std::pair("mm", 1e-3), std::pair("um", 1e-6), std::pair("\xb5m", 1e-6),
          std::pair("\xc2\xb5m", 1e-6), std::pair("\xce\xbcm", 1e-6), std::pair("nm", 1e-9),
          std::pair("\xc5", 1e-10), std::pair("\xc3\x85", 1e-10), std::pair("pm", 1e-12)})
      if (unit == written) amplitude.metres = factor * value;
    break;
  }
  return amplitude;
}

std::string nm(double metres) {
  std::ostringstream text;
  text.precision(6);
  text << 1e9 * metres << " nm";
  return text.str();
}

}  // namespace

TitleSays title_says(std::string_view title) {
  const std::vector<std::string> words = words_of(title);
  const auto any = [&](std::initializer_list<const char*> of) {
    return std::any_of(of.begin(), of.end(), [&](const char* word) {
      return std::find(words.begin(), words.end(), word) != words.end();
    });
  };
  if (any({"error", "err", "amplitude", "ampl", "amp", "deflection", "defl", "phase", "friction", "adhesion",
           "deformation", "indentation", "setpoint", "lateral"}))
    return TitleSays::kSignal;
  if (any({"height", "z", "topography", "zsensor", "heightsensor"})) return TitleSays::kHeight;
  if (!any({"sensor"})) return TitleSays::kNothing;
  return any({"x", "y"}) ? TitleSays::kSignal : TitleSays::kHeight;
}

std::string differs_from_wsxm(std::string_view original, const GwyField& field) {
  if (!original.starts_with("WSxM file")) return {};
  const std::string remedy = ": set it right in Gwyddion and save it as .gwy";
  for (const auto& [name, read] :
       {std::pair("X Amplitude", field.width), std::pair("Y Amplitude", field.height)}) {
    const Amplitude stated = amplitude_of(original, name);
    if (!stated.stated) continue;
    if (!stated.metres) return std::string("has in its header an ") + name + " that cannot be read" + remedy;
    if (!(std::abs(read / *stated.metres - 1) < 0.01))
      return std::string("has ") + name + " " + nm(*stated.metres) + " in its header, and Gwyddion makes " +
             nm(read) + " of it" + remedy;
  }
  double low = HUGE_VAL;
  double high = -HUGE_VAL;
  for (std::size_t i = 0; i < field.count(); ++i) {
    low = std::min(low, field.value(i));
    high = std::max(high, field.value(i));
  }
  // Heights may be clipped or levelled when they are saved, but not by a prefix of their unit.
  const Amplitude stated = amplitude_of(original, "Z Amplitude");
  if (field.unit_z != "m" || !stated.metres || !(*stated.metres > 0) || !(high > low)) return {};
  const double ratio = (high - low) / *stated.metres;
  if (ratio > 0.01 && ratio < 100) return {};
  return "has Z Amplitude " + nm(*stated.metres) + " in its header, and Gwyddion makes " + nm(high - low) +
         " of it" + remedy;
}

}  // namespace telenano::import

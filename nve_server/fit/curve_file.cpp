#include "telenano/nve_server/fit/curve_file.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>

#include "telenano/nve_server/fit/text_table.h"

namespace telenano::fit {
namespace {

constexpr double kLargest = 1e9;  // nm, V or nN: nothing that a microscope measures
struct Unit {
  const char* name;
  double factor;  // to nm, nN or V
  char kind;      // l, f, v
};
constexpr std::array<Unit, 11> kUnits{{{"nm", 1, 'l'},
                                       {"um", 1e3, 'l'},
                                       {"pm", 1e-3, 'l'},
                                       {"m", 1e9, 'l'},
                                       {"nn", 1, 'f'},
                                       {"un", 1e3, 'f'},
                                       {"pn", 1e-3, 'f'},
                                       {"n", 1e9, 'f'},
                                       {"mv", 1e-3, 'v'},
                                       {"v", 1, 'v'},
                                       {"volt", 1, 'v'}}};

/// The last word of a column's name.
const Unit* unit_in(const std::string& name) {
  std::size_t end = name.size();
  const auto letter = [](char c) { return c >= 'a' && c <= 'z'; };
  while (end > 0 && !letter(name[end - 1])) --end;
  std::size_t begin = end;
  while (begin > 0 && letter(name[begin - 1])) --begin;
  const std::string word = name.substr(begin, end - begin);
  for (const Unit& unit : kUnits)
    if (word == unit.name) return &unit;
  return nullptr;
}

bool contains_any(const std::string& name, std::initializer_list<const char*> words) {
  return std::any_of(words.begin(), words.end(),
                     [&](const char* word) { return name.find(word) != std::string::npos; });
}

bool is_z(const std::string& name) {
  return contains_any(name, {"base_z", "z-sens", "z_sens", "zsnsr", "piezo", "height", "z sens"}) ||
         name.starts_with("z_") || name.starts_with("z ") || name.starts_with("z(") || name.starts_with("z[");
}
bool is_bend(const std::string& name) {
  return contains_any(name, {"defl"});
}
bool is_force(const std::string& name) {
  return contains_any(name, {"force"});
}
bool of_retract(const std::string& name) {
  return contains_any(name, {"retract"});
}
bool of_approach(const std::string& name) {
  return contains_any(name, {"extend", "approach"});
}

struct Choice {
  int z = -1;
  int bend = -1;
};

/// `way`: 0 approach, 1 retract, -1 both in one column.
Choice choose(const Table& table, const ColumnChoice& columns, int way) {
  Choice choice;
  bool by_force = false;
  for (std::size_t i = 0; i < table.names.size(); ++i) {
    const std::string& name = table.names[i];
    const int at = static_cast<int>(i);
    if (at == table.direction) continue;
    const bool fits = way < 0    ? !of_approach(name) && !of_retract(name)
                      : way == 0 ? of_approach(name)
                                 : of_retract(name);
    if (!columns.z.empty() ? name == lower(columns.z) : fits && choice.z < 0 && is_z(name)) choice.z = at;
    if (!columns.deflection.empty()) {
      if (name == lower(columns.deflection)) choice.bend = at;
    } else if (fits && is_bend(name) && (choice.bend < 0 || by_force)) {
      choice.bend = at;
      by_force = false;
    } else if (fits && is_force(name) && choice.bend < 0) {
      choice.bend = at;
      by_force = true;
    }
  }
  return choice;
}

std::string names_of(const Table& table) {
  std::string text;
  for (const std::string& name : table.names) text += (text.empty() ? "" : ", ") + name;
  return plain_line(text, 100);
}

std::uint64_t little(std::string_view bytes, std::size_t at, std::size_t n) {
  std::uint64_t value = 0;
  for (std::size_t i = n; i-- > 0;) value = value << 8 | static_cast<unsigned char>(bytes[at + i]);
  return value;
}

/// "Key: 1.5" of Asylum's note.
std::optional<double> noted(std::string_view note, const std::string& key) {
  std::size_t at = 0;
  while ((at = note.find(key + ":", at)) != std::string_view::npos) {
    const bool starts = at == 0 || note[at - 1] == '\r' || note[at - 1] == '\n';
    at += key.size() + 1;
    if (!starts) continue;
    std::string_view value = note.substr(at, note.find_first_of("\r\n,", at) - at);
    double number = 0;
    if (read_number(trimmed(value), number) && std::isfinite(number)) return number;
  }
  return std::nullopt;
}

}  // namespace

std::string plain_line(std::string_view text, std::size_t longest) {
  std::string out(text.substr(0, longest));
  for (char& c : out)
    if (c < 0x20 || c > 0x7e) c = '?';
  if (text.size() > longest) out += "...";
  return out;
}

void check_curve(RawCurve& curve) {
  if (!curve.error.empty()) return;
  const std::array<const RawSegment*, 2> segments{&curve.approach, &curve.retract};
  for (std::size_t i = 0; i < segments.size(); ++i) {
    const RawSegment& segment = *segments[i];
    const std::string way = i == 0 ? "approach" : "retract";
    if (segment.z_nm.size() != segment.deflection.size()) {
      curve.error = "has " + std::to_string(segment.z_nm.size()) + " heights and " +
                    std::to_string(segment.deflection.size()) + " deflections in its " + way;
      return;
    }
    if (segment.z_nm.size() < kPointsMin) {
      curve.error = "has " + std::to_string(segment.z_nm.size()) + " points in its " + way +
                    ", expected at least " + std::to_string(kPointsMin);
      return;
    }
    for (std::size_t j = 0; j < segment.z_nm.size(); ++j) {
      if (!(std::abs(segment.z_nm[j]) <= kLargest) || !(std::abs(segment.deflection[j]) <= kLargest)) {
        curve.error = "has no usable number at point " + std::to_string(j + 1) + " of its " + way;
        return;
      }
    }
  }
}

void split_at_turn(const std::vector<double>& z, const std::vector<double>& deflection, RawCurve& curve) {
  const std::size_t n = std::min(z.size(), deflection.size());
  if (n == 0) return;
  std::size_t turn = 0;
  for (std::size_t i = 0; i < n; ++i)
    if (std::abs(z[i] - z[0]) > std::abs(z[turn] - z[0])) turn = i;
  const auto middle = static_cast<std::ptrdiff_t>(turn + 1);
  curve.approach = {{z.begin(), z.begin() + middle}, {deflection.begin(), deflection.begin() + middle}};
  curve.retract = {{z.begin() + middle, z.end()}, {deflection.begin() + middle, deflection.end()}};
}

RawCurve read_csv(std::string_view bytes, const ColumnChoice& columns) {
  RawCurve curve;
  const Table table =
      read_table(bytes,
                 ".csv, .ibw (Igor 5), .jpk-force, .h5 (afmformats) or a NanoScope force curve; "
                 "others as ",
                 "z_nm,deflection_nm");
  curve.error = table.error;
  if (!curve.error.empty()) return curve;
  const Choice both = choose(table, columns, -1);
  const bool separate = both.z < 0 || both.bend < 0;
  const Choice approach = separate ? choose(table, columns, 0) : both;
  const Choice retract = separate ? choose(table, columns, 1) : both;
  for (const Choice& choice : {approach, retract}) {
    if (choice.z >= 0 && choice.bend >= 0) continue;
    curve.error = std::string("has no column for the ") + (choice.z < 0 ? "height" : "deflection or force") +
                  ": name it by " + (choice.z < 0 ? "--z-column" : "--deflection-column") + "; it has " +
                  names_of(table);
    return curve;
  }
  const auto unit_of = [&](int column) { return unit_in(table.names[static_cast<std::size_t>(column)]); };
  const Unit* z_unit = unit_of(approach.z);
  const Unit* bend_unit = unit_of(approach.bend);
  if (z_unit == nullptr || z_unit->kind != 'l' || bend_unit == nullptr) {
    const int bad = z_unit == nullptr || z_unit->kind != 'l' ? approach.z : approach.bend;
    curve.error = "has a column '" + plain_line(table.names[static_cast<std::size_t>(bad)]) +
                  "' without a unit that fits at the end of its name: expected like z_nm, deflection_nm, "
                  "deflection_v or force_nn";
    return curve;
  }
  curve.unit = bend_unit->kind == 'l'   ? DeflectionUnit::kNanometre
               : bend_unit->kind == 'v' ? DeflectionUnit::kVolt
                                        : DeflectionUnit::kNanonewton;
  curve.what = "table, " + plain_line(table.names[static_cast<std::size_t>(approach.z)]) + " and " +
               plain_line(table.names[static_cast<std::size_t>(approach.bend)]);
  const auto take = [&](const Choice& choice, int way, RawSegment& segment) {
    const auto& z = table.columns[static_cast<std::size_t>(choice.z)];
    const auto& bend = table.columns[static_cast<std::size_t>(choice.bend)];
    for (std::size_t i = 0; i < z.size(); ++i) {
      if (way >= 0 && table.direction >= 0 && table.way[i] != way) continue;
      if (separate && std::isnan(z[i]) && std::isnan(bend[i])) continue;  // the shorter way's end
      segment.z_nm.push_back(z_unit->factor * z[i]);
      segment.deflection.push_back(bend_unit->factor * bend[i]);
    }
  };
  if (separate || table.direction >= 0) {
    take(approach, 0, curve.approach);
    take(retract, 1, curve.retract);
  } else {
    RawSegment all;
    take(both, -1, all);
    split_at_turn(all.z_nm, all.deflection, curve);
  }
  check_curve(curve);
  return curve;
}

RawCurve read_ibw(std::string_view bytes, const ColumnChoice& columns) {
  constexpr std::size_t kHeader = 384;  // BinHeader5 and WaveHeader5
  RawCurve curve;
  const auto fail = [&](const std::string& why) {
    curve.error = why;
    return curve;
  };
  if (bytes.size() < kHeader) return fail("is an Igor wave that ends within its header");
  const auto type = little(bytes, 80, 2);
  const std::size_t width = type == 2 ? 4 : type == 4 ? 8 : 0;
  const std::size_t rows = little(bytes, 132, 4);
  const std::size_t count = little(bytes, 136, 4);
  if (width == 0) return fail("is an Igor wave whose numbers are not real floating point");
  if (rows < 1 || rows > kPointsMax || count < 2 || count > kColumnsMax || little(bytes, 140, 4) != 0)
    return fail("is an Igor wave, but not of points by 2 to 64 columns: not a force curve");
  const std::size_t data = rows * count * width;
  if (bytes.size() - kHeader < data) return fail("is cut off: numbers of the Igor wave are missing");
  // After the numbers: formula, note, units, labels.
  const std::size_t formula = little(bytes, 8, 4);
  const std::size_t note_size = little(bytes, 12, 4);
  std::size_t units = little(bytes, 16, 4);
  for (std::size_t i = 0; i < 4; ++i) units += little(bytes, 20 + 4 * i, 4);
  const std::size_t label_0 = little(bytes, 36, 4);
  const std::size_t label_1 = little(bytes, 40, 4);
  const std::string_view rest = bytes.substr(kHeader + data);
  if (formula > rest.size() || note_size > rest.size() - formula ||
      units + label_0 > rest.size() - formula - note_size ||
      label_1 > rest.size() - formula - note_size - units - label_0) {
    return fail("is cut off: a part of the Igor wave's note is missing");
  }
  const std::string_view note = rest.substr(formula, note_size);
  const std::string_view labels = rest.substr(formula + note_size + units + label_0, label_1);
  std::vector<std::string> names(count);
  for (std::size_t i = 0; i < count && 32 * (i + 2) <= labels.size(); ++i) {
    const std::string_view label = labels.substr(32 * (i + 1), 32);
    names[i] = std::string(label.substr(0, label.find('\0')));
  }
  const auto column = [&](const std::string& asked, std::initializer_list<const char*> usual) -> std::size_t {
    for (const std::string& name : names)
      if (!asked.empty() && lower(name) == lower(asked))
        return static_cast<std::size_t>(&name - names.data());
    for (const char* word : usual) {
      for (std::size_t i = 0; i < count && asked.empty(); ++i)
        if (lower(names[i]) == word) return i;
    }
    return count;
  };
  const std::size_t z = column(columns.z, {"zsnsr", "lvdt", "raw"});
  const std::size_t bend = column(columns.deflection, {"defl"});
  if (z == count || bend == count) {
    std::string all;
    for (const std::string& name : names) all += (all.empty() ? "" : ", ") + name;
    return fail(std::string("has no column for the ") + (z == count ? "height" : "deflection") +
                ": name it by " + (z == count ? "--z-column" : "--deflection-column") + "; it has " +
                plain_line(all, 100));
  }
  const auto value = [&](std::size_t row, std::size_t of) {
    const std::size_t at = kHeader + (of * rows + row) * width;
    if (width == 4) {
      const auto bits = static_cast<std::uint32_t>(little(bytes, at, 4));
      float number = 0;
      std::memcpy(&number, &bits, sizeof number);
      return static_cast<double>(number);
    }
    const std::uint64_t bits = little(bytes, at, 8);
    double number = 0;
    std::memcpy(&number, &bits, sizeof number);
    return number;
  };
  std::vector<double> heights(rows);
  std::vector<double> deflections(rows);
  for (std::size_t i = 0; i < rows; ++i) {
    heights[i] = 1e9 * value(i, z);
    deflections[i] = 1e9 * value(i, bend);
  }
  split_at_turn(heights, deflections, curve);
  const auto stiffness = noted(note, "SpringConstant");
  if (stiffness && *stiffness > 0) curve.stiffness_n_m = stiffness;
  const auto invols = noted(note, "InvOLS");
  if (invols && *invols > 0) curve.invols_nm_v = 1e9 * *invols;
  curve.what = "Igor wave, " + plain_line(names[z]) + " and " + plain_line(names[bend]);
  check_curve(curve);
  return curve;
}

RawCurve read_curve(std::string_view bytes, const ColumnChoice& columns) {
  RawCurve curve;
  if (bytes.empty()) {
    curve.error = "is empty, expected a force curve";
    return curve;
  }
  if (bytes.starts_with("PK")) return read_jpk(bytes, columns);
  if (bytes.starts_with(std::string_view("\5\0", 2))) return read_ibw(bytes, columns);
  if (bytes.starts_with(kHdf5Begin)) return read_hdf5(bytes, columns);
  if (columns.number > 0) {
    curve.error = "contains only one curve: there is no curve number " + std::to_string(columns.number);
    return curve;
  }
  if (bytes.starts_with("\\*Force file list") || bytes.starts_with("\\*File list"))
    return read_nanoscope(bytes, columns);
  if (bytes.starts_with(std::string_view("\2\0", 2)) || bytes.starts_with(std::string_view("\0\5", 2)) ||
      bytes.starts_with(std::string_view("\0\2", 2))) {
    curve.error = "is an Igor wave of an old version or byte order: save it as version 5, or as text";
    return curve;
  }
  return read_csv(bytes, columns);
}

}  // namespace telenano::fit

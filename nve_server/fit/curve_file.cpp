#include "telenano/nve_server/fit/curve_file.h"

#include <algorithm>
#include <array>
#include <cctype>
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

const Unit* unit_named(std::string_view word) {
  for (const Unit& unit : kUnits)
    if (word == unit.name) return &unit;
  return nullptr;
}

bool is_letter(char c) {
  return c >= 'a' && c <= 'z';
}

/// The whole of the last brackets of a column's name, or its last word, where that is a unit by itself: neither
/// "nm/v" nor "1e-9 m".
const Unit* unit_in(std::string_view name) {
  if (name.empty()) return nullptr;
  const std::size_t closes = std::string_view(")]}").find(name.back());
  if (closes != std::string_view::npos) {
    const std::size_t opens = name.rfind("([{"[closes]);
    if (opens == std::string_view::npos) return nullptr;
    return unit_named(trimmed(name.substr(opens + 1, name.size() - opens - 2)));
  }
  std::size_t begin = name.size();
  while (begin > 0 && is_letter(name[begin - 1])) --begin;
  std::size_t end = begin;
  while (end > 0 && std::string_view("_ -./").find(name[end - 1]) != std::string_view::npos) --end;
  std::size_t before = end;
  while (before > 0 && is_letter(name[before - 1])) --before;
  const std::string_view word = name.substr(before, end - before);
  // What stands before it must be a name, not a power, a product or a quotient.
  const bool of_name = begin == 0 || (begin > end && word != "per" && unit_named(word) == nullptr &&
                                      (is_letter(name[end - 1]) || name[end - 1] == ')'));
  return of_name ? unit_named(name.substr(begin)) : nullptr;
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
  return contains_any(name, {"defl"}) && !contains_any(name, {"lateral", "horizontal", "hdefl"});
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

/// A name without its way: the same for "Extend T-B(V)" and "Retract T-B(V)".
std::string without_way(std::string name) {
  for (const std::string_view word : {"extend", "approach", "retract"}) {
    const std::size_t at = name.find(word);
    if (at != std::string::npos) name.replace(at, word.size(), "\n");
  }
  return name;
}

/// `way`: 0 approach, 1 retract, -1 both in one column.
Choice choose(const Table& table, const ColumnChoice& columns, int way) {
  Choice choice;
  bool by_force = false;
  const auto is_asked = [&](const std::string& name, const std::string& asked) {
    return without_way(name) == without_way(lower(asked));
  };
  for (std::size_t i = 0; i < table.names.size(); ++i) {
    const std::string& name = table.names[i];
    const int at = static_cast<int>(i);
    if (at == table.direction) continue;
    const bool fits = way < 0    ? !of_approach(name) && !of_retract(name)
                      : way == 0 ? of_approach(name)
                                 : of_retract(name);
    if (!columns.z.empty() ? fits && is_asked(name, columns.z) : fits && choice.z < 0 && is_z(name))
      choice.z = at;
    if (!columns.deflection.empty()) {
      if (fits && is_asked(name, columns.deflection)) choice.bend = at;
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

/// Names above a line of units alone: each with its unit.
void join_units(Table& table) {
  const auto bare = [](std::string_view name) {
    const bool in_brackets = name.size() > 2 && (name.front() == '(' || name.front() == '[');
    return in_brackets ? name.substr(1, name.size() - 2) : name;
  };
  std::size_t units = 0;
  for (const std::string& name : table.names) units += unit_named(bare(name)) != nullptr ? 1 : 0;
  if (table.above.empty() || units < 2) return;
  for (std::size_t i = 0; i < table.names.size(); ++i)
    table.names[i] = table.above[i] + " (" + std::string(bare(table.names[i])) + ")";
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

void take_stated_stiffness(std::string_view text, RawCurve& curve) {
  std::string first;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find_first_of("\r\n"), text.size());
    const std::string line = lower(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
    std::size_t at = line.find_first_of(":=,;\t");
    if (at == std::string::npos) at = line.find_first_of("0123456789");
    if (at == std::string::npos) continue;
    const char between = line[at];
    std::string key;  // its letters, and what its brackets hold
    std::string unit;
    bool in_brackets = false;
    for (const char c : line.substr(0, at)) {
      if (c == '(' || c == '[' || c == ')' || c == ']')
        in_brackets = c == '(' || c == '[';
      else if (in_brackets)
        unit += c;
      else if (is_letter(c) || c == '/')
        key += c;
    }
    for (const std::string_view written : {"n/m", "nn/nm", "pn/nm", "mn/m", "nm"}) {
      if (!unit.empty() || !key.ends_with(written) || key.size() == written.size()) continue;
      unit = written == "nm" ? "n/m" : written;  // "k_n_m"
      key.resize(key.size() - written.size());
    }
    const bool by_name = contains_any(key, {"springconst", "forceconst"}) &&
                         !contains_any(key, {"display", "adjust", "torsion", "lateral"}) &&
                         line.substr(0, at).find('2') == std::string::npos;  // of another mode
    const bool by_letter = key == "k" || key == "kc" || key == "kcantilever" || key == "kn" ||
                           key == "stiffness" || key == "cantileverstiffness" || key == "leverstiffness";
    if (!by_name && !by_letter) continue;
    at = line.find_first_of("0123456789.+-", at);
    if (at == std::string::npos || line[at > 0 ? at - 1 : 0] == '/') continue;
    std::string number = line.substr(at);
    const std::size_t comma = number.find(',');
    if (between != ',' && comma != std::string::npos && comma + 1 < number.size() &&
        std::isdigit(static_cast<unsigned char>(number[comma + 1])) != 0)
      number[comma] = '.';
    if (number.front() == '+') number.erase(0, 1);
    double value = 0;
    const auto [rest, error] = std::from_chars(number.data(), number.data() + number.size(), value);
    if (error != std::errc() || !(value > 0) || !std::isfinite(value)) continue;
    std::string_view after(rest, static_cast<std::size_t>(number.data() + number.size() - rest));
    after = after.substr(std::min(after.find_first_not_of(" ,;\t\"'(["), after.size()));
    after = after.substr(0, after.find_first_of(" ,;\t\"')]"));
    if (!after.empty()) unit = after;
    double to_n_m = 0;
    if (unit.empty() || unit == "n/m" || unit == "nn/nm") to_n_m = 1;
    if (unit == "pn/nm" || unit == "mn/m") to_n_m = 1e-3;
    if (to_n_m == 0 && !by_name && !contains_any(unit, {"n/", "newton"})) continue;  // another k
    const bool same = !curve.stiffness_n_m || std::abs(to_n_m * value / *curve.stiffness_n_m - 1) < 0.01;
    if (to_n_m == 0 || !same)
      curve.stiffness_unread = (first.empty() ? "" : first + " and ") + plain_line(trimmed(line), 50);
    if (first.empty()) first = plain_line(trimmed(line), 50);
    if (to_n_m != 0 && !curve.stiffness_n_m) curve.stiffness_n_m = to_n_m * value;
  }
  if (!curve.stiffness_unread.empty()) curve.stiffness_n_m.reset();
}

void check_curve(RawCurve& curve) {
  if (!curve.error.empty()) return;
  // What is no sensitivity is none that was said.
  if (curve.invols_nm_v && !(*curve.invols_nm_v >= 0.01 && *curve.invols_nm_v <= 1e5))
    curve.invols_nm_v.reset();
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
                    ", expected at least " + std::to_string(kPointsMin) + ": both ways are needed";
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
  Table table = read_table(bytes,
                           ".csv, .ibw (Igor 5), .jpk-force, .h5 (afmformats) or a NanoScope force curve; "
                           "others as ",
                           "z_nm,deflection_nm");
  curve.error = table.error;
  if (!curve.error.empty()) return curve;
  join_units(table);
  for (const std::string& asked : {lower(columns.z), lower(columns.deflection)}) {
    if (asked.empty() || std::count(table.names.begin(), table.names.end(), asked) < 2) continue;
    curve.error = "has more than one column '" + plain_line(asked) + "': name them differently in the file";
    return curve;
  }
  const Choice both = choose(table, columns, -1);
  const bool separate = both.z < 0 || both.bend < 0;
  const Choice approach = separate ? choose(table, columns, 0) : both;
  const Choice retract = separate ? choose(table, columns, 1) : both;
  for (const Choice& choice : {approach, retract}) {
    if (choice.z >= 0 && choice.bend >= 0) continue;
    const bool no_z = choice.z < 0;
    const std::string& asked = no_z ? columns.z : columns.deflection;
    curve.error = std::string("has no ") +
                  (asked.empty() ? "column for the "
                                 : "'" + plain_line(asked) + "', or no such pair for both ways, as ") +
                  (no_z ? "height" : "deflection or force") + ": name it by " +
                  (no_z ? "--z-column" : "--deflection-column") + "; it has " + names_of(table);
    return curve;
  }
  if (approach.z == approach.bend) {
    curve.error = "cannot have its height and its deflection in one column '" +
                  plain_line(table.names[static_cast<std::size_t>(approach.z)]) +
                  "': choose others by --z-column and --deflection-column; it has " + names_of(table);
    return curve;
  }
  const auto unit_of = [&](int column) { return unit_in(table.names[static_cast<std::size_t>(column)]); };
  for (const Choice& choice : {approach, retract}) {
    const Unit* z = unit_of(choice.z);
    const bool z_bad = z == nullptr || z->kind != 'l';
    if (!z_bad && unit_of(choice.bend) != nullptr) continue;
    curve.error = "has a column '" +
                  plain_line(table.names[static_cast<std::size_t>(z_bad ? choice.z : choice.bend)]) +
                  "' without a unit that fits at the end of its name: expected like z_nm, deflection_nm, "
                  "deflection_v or force_nn, with m, um, nm, pm, V, mV, N, uN, nN or pN";
    return curve;
  }
  const Unit* bend_unit = unit_of(approach.bend);
  if (bend_unit->kind != unit_of(retract.bend)->kind) {
    curve.error = "has its deflection in different units for approach and retract; it has " + names_of(table);
    return curve;
  }
  curve.unit = bend_unit->kind == 'l'   ? DeflectionUnit::kNanometre
               : bend_unit->kind == 'v' ? DeflectionUnit::kVolt
                                        : DeflectionUnit::kNanonewton;
  take_stated_stiffness(table.said, curve);
  // A file's force is its deflection times its lever's stiffness: with that it is what was measured again.
  double from_force = 1;
  if (curve.unit == DeflectionUnit::kNanonewton && curve.stiffness_n_m) {
    from_force = 1.0 / *curve.stiffness_n_m;
    curve.unit = DeflectionUnit::kNanometre;
  }
  curve.what = "table, " + plain_line(table.names[static_cast<std::size_t>(approach.z)]) + " and " +
               plain_line(table.names[static_cast<std::size_t>(approach.bend)]);
  const auto take = [&](const Choice& choice, int way, RawSegment& segment) {
    const auto& z = table.columns[static_cast<std::size_t>(choice.z)];
    const auto& bend = table.columns[static_cast<std::size_t>(choice.bend)];
    const double z_factor = unit_of(choice.z)->factor;
    const double bend_factor = unit_of(choice.bend)->factor * from_force;
    for (std::size_t i = 0; i < z.size(); ++i) {
      if (way >= 0 && table.direction >= 0 && table.way[i] != way) continue;
      if (separate && std::isnan(z[i]) && std::isnan(bend[i])) continue;  // the shorter way's end
      segment.z_nm.push_back(z_factor * z[i]);
      segment.deflection.push_back(bend_factor * bend[i]);
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
    // Others may be in volts or degrees: a wave does not say its columns' units.
    for (const std::string& name : names)
      if (!asked.empty() && lower(name) == lower(asked) &&
          std::any_of(usual.begin(), usual.end(), [&](const char* word) { return lower(name) == word; }))
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
                " that is known to be in metres (" + (z == count ? "ZSnsr, LVDT or Raw" : "Defl") +
                "); it has " + plain_line(all, 100) +
                ": export it as a table with columns like z_nm,deflection_nm");
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
  take_stated_stiffness(note, curve);
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

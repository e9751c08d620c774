#include "telenano/nve_server/fit/text_table.h"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "telenano/nve_server/fit/curve_file.h"

namespace telenano::fit {
namespace {

std::vector<std::string_view> split(std::string_view line, char by) {
  std::vector<std::string_view> fields;
  while (fields.size() < kColumnsMax) {
    const std::size_t end = line.find(by);
    fields.push_back(trimmed(line.substr(0, end)));
    if (end == std::string_view::npos) break;
    line.remove_prefix(end + 1);
  }
  return fields;
}

std::string_view next_line(std::string_view& text) {
  // A line that ends in both is followed by an empty one, which is passed over.
  const std::size_t end = std::min(text.find_first_of("\r\n"), text.size());
  const std::string_view line = text.substr(0, end);
  text.remove_prefix(std::min(end + 1, text.size()));
  return trimmed(line);
}

/// Where no comma parts the columns, it may be the decimal one: 0,5 for 0.5.
bool read_field(std::string_view text, char by, double& value) {
  if (read_number(text, value)) return true;
  const std::size_t comma = by == ',' ? std::string_view::npos : text.find(',');
  if (comma == std::string_view::npos) return false;
  std::string with_point(text);
  with_point[comma] = '.';
  return read_number(with_point, value);
}

std::size_t numbers_in(const std::vector<std::string_view>& fields, char by) {
  double value = 0;
  return static_cast<std::size_t>(std::count_if(
      fields.begin(), fields.end(), [&](std::string_view f) { return read_field(f, by, value); }));
}

}  // namespace

std::string lower(std::string_view text) {
  std::string out(text);
  for (char& c : out)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  for (const std::string_view micro : {"\xc2\xb5", "\xce\xbc"})
    for (std::size_t at = 0; (at = out.find(micro, at)) != std::string::npos;) out.replace(at, 2, "u");
  // In Latin-1 the byte stands alone; in UTF-8 it follows another one that is no ASCII.
  for (std::size_t i = 0; i < out.size(); ++i)
    if (out[i] == '\xb5' && (i == 0 || static_cast<unsigned char>(out[i - 1]) < 0x80)) out[i] = 'u';
  return out;
}

std::string_view trimmed(std::string_view text) {
  const auto blank = [](char c) { return c == ' ' || c == '\t' || c == '\r' || c == '"'; };
  while (!text.empty() && blank(text.front())) text.remove_prefix(1);
  while (!text.empty() && blank(text.back())) text.remove_suffix(1);
  return text;
}

bool read_number(std::string_view text, double& value) {
  if (!text.empty() && text.front() == '+') text.remove_prefix(1);
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size();
}

Table read_table(std::string_view text, const std::string& formats, const std::string& like) {
  Table table;
  // Spreadsheets begin UTF-8 with a mark.
  if (text.substr(0, 3) == "\xef\xbb\xbf") text.remove_prefix(3);
  const std::string_view all = text;
  std::string_view header;
  std::string_view before;
  char by = ',';
  std::string_view body;
  // The header: followed by a line of as many fields, two of them numbers, itself without numbers.
  while (!text.empty() && header.empty()) {
    std::string_view line = next_line(text);
    // The names may stand in a comment, if the numbers follow it.
    const bool comment = !line.empty() && line.front() == '#';
    while (!line.empty() && (line.front() == '#' || line.front() == ' ' || line.front() == '\t'))
      line.remove_prefix(1);
    if (line.empty()) continue;
    for (const char candidate : {',', ';', '\t'}) {
      const auto fields = split(line, candidate);
      if (fields.size() < 2 || numbers_in(fields, candidate) > 0) continue;
      std::string_view rest = text;
      std::string_view below = next_line(rest);
      while (!rest.empty() && (below.empty() || (below.front() == '#' && !comment))) below = next_line(rest);
      const auto values = split(below, candidate);
      if (values.size() != fields.size() || numbers_in(values, candidate) < 2) continue;
      header = line;
      by = candidate;
      body = text;
      break;
    }
    if (!header.empty()) break;
    before = line;
    table.said += std::string(line) + '\n';
  }
  if (header.empty()) {
    table.error =
        all.find('\0') != std::string_view::npos
            ? "is not in a supported format: expected " + formats + "a table with columns like " + like
            : "has no table with a line of column names, like " + like;
    return table;
  }
  for (const std::string_view name : split(header, by)) table.names.push_back(lower(name));
  const std::size_t n = table.names.size();
  for (const std::string_view field : split(before, by)) table.above.push_back(lower(field));
  if (table.above.size() != n) table.above.clear();
  table.columns.resize(n);
  for (const char* name :
       {"segment", "direction", "way"}) {  // exports number their segments and say the way too
    const auto found = std::find(table.names.begin(), table.names.end(), name);
    if (found != table.names.end()) table.direction = static_cast<int>(found - table.names.begin());
  }
  std::size_t rows = 0;
  std::vector<double> segments;  // numbers of the ways, in the order in which they begin
  while (!body.empty()) {
    const std::string_view line = next_line(body);
    if (!line.empty() && line.front() == '#') table.said += std::string(line.substr(1)) + '\n';
    if (line.empty() || line.front() == '#') continue;
    const auto fields = split(line, by);
    if (fields.size() != n) {
      table.error = "has a row of " + std::to_string(fields.size()) + " columns after " +
                    std::to_string(rows) + " rows of " + std::to_string(n);
      return table;
    }
    if (++rows > kPointsMax) {
      table.error = "has more than a million rows";
      return table;
    }
    for (std::size_t i = 0; i < n; ++i) {
      double value = std::nan("");
      if (!fields[i].empty() && !read_field(fields[i], by, value)) value = std::nan("");
      table.columns[i].push_back(value);
    }
    if (table.direction < 0) continue;
    const std::string word = lower(fields[static_cast<std::size_t>(table.direction)]);
    double segment = 0;
    if (word.find("retract") != std::string::npos) {
      table.way.push_back(1);
    } else if (word.find("approach") != std::string::npos || word.find("extend") != std::string::npos) {
      table.way.push_back(0);
    } else if (read_number(word, segment)) {
      if (segments.size() < 3 && std::find(segments.begin(), segments.end(), segment) == segments.end())
        segments.push_back(segment);
      table.way.push_back(0);
    } else {
      table.error = "has '" + plain_line(word, 20) + "' in its column " +
                    table.names[static_cast<std::size_t>(table.direction)] +
                    ": expected approach or retract; leave out the rows of a pause";
      return table;
    }
  }
  if (segments.size() > 2 ||
      (segments.size() == 2 && std::count(table.way.begin(), table.way.end(), 1) > 0)) {
    table.error = "has more than two segments in its column " +
                  table.names[static_cast<std::size_t>(table.direction)] +
                  ": leave one approach and its retract, without a pause";
  } else if (!segments.empty()) {
    // 0 and 1 are approach and retract in any order; other numbers count the segments in time.
    const bool known = segments.size() < 2 || (segments[0] == 1 && segments[1] == 0);
    const double retract = known ? 1 : segments[1];
    const std::vector<double>& numbers = table.columns[static_cast<std::size_t>(table.direction)];
    for (std::size_t i = 0; i < rows; ++i) table.way[i] = numbers[i] == retract ? 1 : 0;
  }
  return table;
}

}  // namespace telenano::fit

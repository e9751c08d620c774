#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace telenano::fit {

inline constexpr std::size_t kColumnsMax = 64;

/// In small letters (ASCII), and µ (UTF-8 or Latin-1, the micro sign or the Greek letter) as u.
std::string lower(std::string_view text);
/// Without blanks and quotes at its ends.
std::string_view trimmed(std::string_view text);
/// A whole number or decimal, nothing else.
bool read_number(std::string_view text, double& value);

/// A table with a line of names, by commas, semicolons or tabs (with the last two, decimal commas are read, too), its lines ended by
/// LF, CR or both, with or without the byte order mark of UTF-8.
struct Table {
  std::vector<std::string> names;            ///< in small letters
  std::vector<std::vector<double>> columns;  ///< NaN: no number
  int direction = -1;
  std::vector<int> way;            ///< by direction: 0 approach, 1 retract
  std::vector<std::string> above;  ///< the fields of the line before the names, if it has as many
  std::string said;                ///< the lines before the names and the comments, each ended by LF
  std::string error;
};

/// `formats` says in an error what files there are beside tables, `like` what the names look like.
Table read_table(std::string_view text, const std::string& formats, const std::string& like);

}  // namespace telenano::fit

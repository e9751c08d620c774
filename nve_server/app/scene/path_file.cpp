#include "telenano/nve_server/app/scene/path_file.h"

#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string_view>

#include "telenano/common/base/error.h"

namespace telenano::app {
namespace {

constexpr std::string_view kHeader = "t_s,x_nm,y_nm,z_nm";
constexpr std::size_t kRowsMax = 10'000'000;
constexpr double kTimeMax_s = 1e6;
constexpr double kLengthMax_nm = 1e7;

std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(" \t\r");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t\r") - first + 1);
}

std::string without_blanks(std::string_view text) {
  std::string out;
  for (const char c : text) {
    if (c != ' ' && c != '\t') out.push_back(c);
  }
  return out;
}

}  // namespace

std::vector<PathPoint> parse_path(const std::string& text, const std::string& name) {
  std::vector<PathPoint> path;
  std::size_t number = 0;
  bool headed = false;
  const auto fail = [&](const std::string& message) {
    throw UserError(name + ":" + std::to_string(number) + ": " + message);
  };
  std::string_view rest = text;
  while (!rest.empty()) {
    ++number;
    const std::size_t end = rest.find('\n');
    const std::string_view line = trimmed(rest.substr(0, end));
    rest = end == std::string_view::npos ? std::string_view() : rest.substr(end + 1);
    if (line.empty() || line.front() == '#') continue;
    if (!headed) {
      if (without_blanks(line) != kHeader) fail("expected the header " + std::string(kHeader));
      headed = true;
      continue;
    }
    double value[4];
    std::string_view left = line;
    int fields = 0;
    for (bool more = true; more; ++fields) {
      const std::size_t comma = left.find(',');
      const std::string_view field = trimmed(left.substr(0, comma));
      more = comma != std::string_view::npos;
      if (more) left = left.substr(comma + 1);
      if (fields >= 4) continue;
      const auto [stop, error] = std::from_chars(field.data(), field.data() + field.size(), value[fields]);
      const double most = fields == 0 ? kTimeMax_s : kLengthMax_nm;
      if (error != std::errc() || stop != field.data() + field.size() || !(std::abs(value[fields]) <= most)) {
        fail("field " + std::to_string(fields + 1) + " is '" + std::string(field.substr(0, 40)) +
             "', expected a number up to " + (fields == 0 ? "1e6 s" : "1e7 nm"));
      }
    }
    if (fields != 4) fail("has " + std::to_string(fields) + " fields, expected 4: " + std::string(kHeader));
    if (!path.empty() && !(value[0] > path.back().t_s)) fail("the time does not increase");
    if (path.size() == kRowsMax) fail("there are more than 1e7 rows");
    path.push_back({value[0], Vec3(value[1], value[2], value[3])});
  }
  if (!headed) throw UserError(name + ": is empty, expected the header " + std::string(kHeader));
  if (path.empty()) throw UserError(name + ": has no rows after the header");
  return path;
}

std::vector<PathPoint> read_path(const std::string& path) {
  std::error_code error;
  if (std::filesystem::is_directory(path, error)) {
    throw UserError(path + ": is a folder, expected a path as CSV");
  }
  std::ifstream file(path, std::ios::binary);
  if (!file) throw UserError(path + ": the path cannot be read: " + std::strerror(errno));
  std::ostringstream text;
  text << file.rdbuf();
  return parse_path(text.str(), path);
}

}  // namespace telenano::app

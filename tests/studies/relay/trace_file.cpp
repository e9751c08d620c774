#include "tests/studies/relay/trace_file.h"

#include <fmt/format.h>

#include <cmath>
#include <fstream>
#include <string>

#include "telenano/common/base/error.h"
#include "tests/studies/parse_list.h"

namespace telenano::studies {
namespace {

constexpr double kLongest_s = 1e6;
constexpr double kLongestDelay_ms = 60'000;

}  // namespace

std::vector<net::TraceRow> load_trace(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::string line;
  if (!in.is_open() || !std::getline(in, line))
    throw UserError(fmt::format("relay: --trace: {}: cannot be read, or is empty", file.string()));
  const auto without_return = [](std::string& text) {
    if (!text.empty() && text.back() == '\r') text.pop_back();
  };
  without_return(line);
  if (line != "time_s,delay_ms,lost") {
    throw UserError(
        fmt::format("relay: --trace: {}, line 1: expected the header time_s,delay_ms,lost", file.string()));
  }
  std::vector<net::TraceRow> rows;
  double first_s = 0;
  for (int number = 2; std::getline(in, line); ++number) {
    without_return(line);
    if (line.empty()) continue;
    const std::string where = fmt::format("relay: --trace: {}, line {}", file.string(), number);
    const std::vector<double> cells = parse_list(line, where);
    if (cells.size() != 3) throw UserError(fmt::format("{}: {} cells; expected 3", where, cells.size()));
    if (!(std::fabs(cells[0]) <= kLongest_s))
      throw UserError(fmt::format("{}: time_s: {}; expected at most {}", where, cells[0], kLongest_s));
    if (!(cells[1] >= 0 && cells[1] <= kLongestDelay_ms))
      throw UserError(fmt::format("{}: delay_ms: {}; expected 0 to {}", where, cells[1], kLongestDelay_ms));
    if (!(cells[2] == 0 || cells[2] == 1))
      throw UserError(fmt::format("{}: lost: {}; expected 0 or 1", where, cells[2]));
    if (rows.empty()) first_s = cells[0];
    const std::int64_t time_ns = std::llround((cells[0] - first_s) * 1e9);
    if (!rows.empty() && time_ns <= rows.back().time_ns)
      throw UserError(fmt::format("{}: time_s: {}; expected more than in the row before", where, cells[0]));
    rows.push_back({time_ns, std::llround(cells[1] * 1e6), cells[2] == 1});
  }
  if (rows.empty()) throw UserError(fmt::format("relay: --trace: {}: no rows", file.string()));
  return rows;
}

}  // namespace telenano::studies

#include "tests/studies/stress/table.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>
#include <map>

#include "telenano/common/base/error.h"

namespace telenano::studies::stress {
namespace {

namespace fs = std::filesystem;

constexpr const char* kManifest = "manifest.txt";
constexpr const char* kShards = "shards";

struct RealColumn {
  const char* name;
  double Outcome::*value;
};
constexpr RealColumn kReals[] = {
    {"violated_s", &Outcome::violated_s},     {"margin_mj", &Outcome::margin_mj},
    {"extracted_mj", &Outcome::extracted_mj}, {"given_mj", &Outcome::given_mj},
    {"generated_mj", &Outcome::generated_mj}, {"quantum_mj", &Outcome::quantum_mj},
    {"late_mj", &Outcome::late_mj},           {"peak_n", &Outcome::peak_n},
    {"force_step_n", &Outcome::force_step_n}, {"force_error_n", &Outcome::force_error_n},
    {"shown_ratio", &Outcome::shown_ratio},   {"drift_mm", &Outcome::drift_mm},
    {"swing_mm", &Outcome::swing_mm},         {"tip_nn", &Outcome::tip_nn},
    {"over_force", &Outcome::over_force},     {"duty", &Outcome::duty},
    {"recover_s", &Outcome::recover_s},       {"stopped_s", &Outcome::stopped_s},
    {"too_fast_s", &Outcome::too_fast_s}};

struct CountColumn {
  const char* name;
  std::int64_t Outcome::*value;
};
constexpr CountColumn kCounts[] = {{"clamp_ticks", &Outcome::clamp_ticks},
                                   {"limit_ticks", &Outcome::limit_ticks},
                                   {"stop_ticks", &Outcome::stop_ticks},
                                   {"sessions", &Outcome::sessions},
                                   {"refused", &Outcome::refused},
                                   {"handed_over", &Outcome::handed_over},
                                   {"ticks", &Outcome::ticks}};

std::string column_name(const char* key) {
  std::string name = key;
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
}

std::vector<std::string> split(const std::string& line) {
  std::vector<std::string> cells(1);
  for (const char c : line) {
    if (c == ',') {
      cells.emplace_back();
    } else {
      cells.back() += c;
    }
  }
  return cells;
}

template <class T>
T number(const std::string& cell, int base = 10) {
  T value{};
  const char* const end = cell.data() + cell.size();
  std::from_chars_result result{};
  if constexpr (std::is_floating_point_v<T>) {
    if (cell.empty()) return std::numeric_limits<T>::quiet_NaN();
    result = std::from_chars(cell.data(), end, value);
  } else {
    result = std::from_chars(cell.data(), end, value, base);
  }
  if (result.ec != std::errc() || result.ptr != end) throw RunError("'" + cell + "' is no number");
  return value;
}

std::string slurp(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw UserError(path.string() + ": cannot be read");
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

std::string head_line(const Manifest& manifest, const Shard& shard) {
  return fmt::format("# {} shard={}/{}", manifest.text, shard.number, shard.of);
}

[[noreturn]] void fail(const fs::path& path, const char* what) {
  throw UserError(fmt::format("{}: {}: {}", path.string(), what, std::strerror(errno)));
}

void write_all(int file, const fs::path& path, const std::string& text) {
  for (std::size_t done = 0; done < text.size();) {
    const ssize_t n = ::write(file, text.data() + done, text.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) throw RunError(fmt::format("{}: cannot be written: {}", path.string(), std::strerror(errno)));
    done += static_cast<std::size_t>(n);
  }
}

/// The first process makes it, whole or not at all; all others must find their own words in it.
void agree_on(const fs::path& folder, const Manifest& manifest) {
  const fs::path path = folder / kManifest;
  const fs::path mine = folder / fmt::format(".manifest-{}", ::getpid());
  {
    std::ofstream out(mine, std::ios::binary);
    out << manifest.text << '\n';
    if (!out.flush()) throw UserError(folder.string() + ": nothing can be written there");
  }
  const bool made = ::link(mine.c_str(), path.c_str()) == 0;
  const bool there = !made && errno == EEXIST;
  std::error_code ignored;
  fs::remove(mine, ignored);
  if (!made && !there) fail(path, "cannot be made");
  const std::string found = read_manifest(folder).text;
  if (found != manifest.text)
    throw UserError(
        fmt::format("{} holds runs of another sweep, nothing was written.\n  there: {}\n  asked for: "
                    "{}\nGive --out another folder, or the same options and program",
                    folder.string(), found, manifest.text));
}

std::size_t runs_of(const std::string& text) {
  const auto at = text.find(" runs=");
  if (at == std::string::npos) throw RunError("manifest without a number of runs");
  return number<std::size_t>(text.substr(at + 6, text.find(' ', at + 6) - at - 6));
}

}  // namespace

std::string table_columns() {
  std::string names = "index,method,mutant,scene,hand,drops,restart,act,playout";
  for (const NumberField& field : number_fields()) names += fmt::format(",{}", column_name(field.key));
  names += ",seed,violated";
  for (const RealColumn& column : kReals) names += fmt::format(",{}", column.name);
  names += ",faults";
  for (const CountColumn& column : kCounts) names += fmt::format(",{}", column.name);
  return names + ",hash";
}

std::string to_csv(const Row& row) {
  const RunSpec& s = row.spec;
  std::string line =
      fmt::format("{},{},{},{},{},{},{},{},{}", row.index, control::method_name(s.method),
                  mutant_name(s.mutant), scene_kind_name(s.scene), hand_name(s.hand), drops_name(s.drops),
                  restart_name(s.restart), act_name(s.act), playout_name(s.playout));
  for (const NumberField& field : number_fields()) line += fmt::format(",{}", s.*field.value);
  line += fmt::format(",{},{}", s.seed, row.outcome.violated);
  for (const RealColumn& column : kReals) {
    const double value = row.outcome.*column.value;
    line += ',';
    if (!std::isnan(value)) line += fmt::format("{}", value);
  }
  line += fmt::format(",{}", row.outcome.faults);
  for (const CountColumn& column : kCounts) line += fmt::format(",{}", row.outcome.*column.value);
  return line + fmt::format(",{:016x}", row.outcome.hash);
}

Row parse_row(const std::string& line) {
  const std::vector<std::string> cells = split(line);
  static const std::size_t columns = split(table_columns()).size();
  if (cells.size() != columns) throw RunError(fmt::format("{} columns instead of {}", cells.size(), columns));
  Row row;
  std::size_t at = 0;
  row.index = number<std::size_t>(cells[at++]);
  std::string text;
  for (const char* key : {"method", "mutant", "scene", "hand", "drops", "restart", "act", "playout"})
    text += fmt::format("{}={} ", key, cells[at++]);
  // A path is not in a table: its points would be.
  row.spec = parse_run_spec(text);
  for (const NumberField& field : number_fields()) row.spec.*field.value = number<double>(cells[at++]);
  row.spec.seed = number<std::uint64_t>(cells[at++]);
  row.outcome.violated = number<std::uint32_t>(cells[at++]);
  for (const RealColumn& column : kReals) row.outcome.*column.value = number<double>(cells[at++]);
  row.outcome.faults = number<std::uint32_t>(cells[at++]);
  for (const CountColumn& column : kCounts) row.outcome.*column.value = number<std::int64_t>(cells[at++]);
  row.outcome.hash = number<std::uint64_t>(cells[at++], 16);
  return row;
}

Manifest read_manifest(const fs::path& folder) {
  std::ifstream in(folder / kManifest);
  Manifest manifest;
  if (!in || !std::getline(in, manifest.text))
    throw UserError((folder / kManifest).string() + ": not there; is this the folder of a sweep?");
  manifest.runs = runs_of(manifest.text);
  return manifest;
}

ShardTable::ShardTable(const fs::path& folder, const Manifest& manifest, const Shard& shard, bool wait) {
  std::error_code error;
  fs::create_directories(folder / kShards, error);
  if (error) throw UserError(folder.string() + ": cannot be created: " + error.message());
  agree_on(folder, manifest);
  path_ = folder / kShards / fmt::format("{:04}-of-{:04}.csv", shard.number, shard.of);
  file_ = ::open(path_.c_str(), O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
  if (file_ < 0) fail(path_, "cannot be written");
  int locked = ::flock(file_, LOCK_EX | LOCK_NB);
  while (locked != 0 && wait && (errno == EWOULDBLOCK || errno == EINTR)) locked = ::flock(file_, LOCK_EX);
  if (locked != 0) {
    ::close(file_);
    throw UserError(path_.string() + ": another process is writing this shard");
  }
  try {
    const std::string text = slurp(path_);
    const std::string head = head_line(manifest, shard);
    const std::string begin = head + '\n' + table_columns() + '\n';
    // Cut off within its first two lines: nothing had been computed.
    if (text.size() < begin.size() && begin.compare(0, text.size(), text) == 0) {
      dropped_ = !text.empty();
      if (::ftruncate(file_, 0) != 0) fail(path_, "cannot be written");
      write_all(file_, path_, begin);
      return;
    }
    if (text.compare(0, begin.size(), begin) != 0)
      throw UserError(path_.string() + ": is of another sweep (see its first line); nothing was written");
    std::size_t at = begin.size(), index = shard.number;
    while (at < text.size()) {
      const auto end = text.find('\n', at);
      if (end == std::string::npos) {
        dropped_ = true;
        if (::ftruncate(file_, static_cast<off_t>(at)) != 0) fail(path_, "cannot be written");
        break;
      }
      try {
        if (parse_row(text.substr(at, end - at)).index != index) throw RunError("out of order");
      } catch (const std::exception& e) {
        throw UserError(fmt::format("{}: row {} is damaged ({}); nothing was written", path_.string(),
                                    rows_ + 1, e.what()));
      }
      ++rows_;
      index += shard.of;
      at = end + 1;
    }
  } catch (...) {
    ::close(file_);
    throw;
  }
}

ShardTable::~ShardTable() {
  if (file_ >= 0) ::close(file_);
}

void ShardTable::append(const Row& row) {
  write_all(file_, path_, to_csv(row) + '\n');
}

void ShardTable::sync() {
  ::fdatasync(file_);
}

std::vector<Row> merge(const fs::path& folder) {
  const Manifest manifest = read_manifest(folder);
  std::map<std::size_t, std::pair<std::string, fs::path>> lines;  // by index: the row and where it is from
  std::error_code error;
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder / kShards, error)) {
    if (entry.path().extension() == ".csv") files.push_back(entry.path());
  }
  if (error || files.empty()) throw UserError((folder / kShards).string() + ": no shards there");
  std::sort(files.begin(), files.end());
  for (const fs::path& path : files) {
    const std::string text = slurp(path);
    const std::string ours = "# " + manifest.text + " shard=";
    const auto first_end = text.find('\n');
    if (first_end == std::string::npos || text.compare(0, ours.size(), ours) != 0)
      throw UserError(fmt::format("{}: is of another sweep than {}\n  there: {}\n  manifest: # {}",
                                  path.string(), (folder / kManifest).string(), text.substr(0, first_end),
                                  manifest.text));
    if (text.back() != '\n')
      throw UserError(path.string() +
                      ": its last line is half-written; run that shard again, it goes on from there");
    const auto second_end = text.find('\n', first_end + 1);
    if (second_end == std::string::npos ||
        text.substr(first_end + 1, second_end - first_end - 1) != table_columns())
      throw UserError(path.string() + ": has other columns than this program's");
    for (std::size_t at = second_end + 1; at < text.size();) {
      const auto end = text.find('\n', at);
      const std::string line = text.substr(at, end - at);
      std::size_t index = 0;
      try {
        index = parse_row(line).index;
      } catch (const std::exception& e) {
        throw UserError(fmt::format("{}: a row is damaged ({})", path.string(), e.what()));
      }
      const auto [old, is_new] = lines.emplace(index, std::pair(line, path));
      if (!is_new)
        throw UserError(fmt::format("run {} is in two shards, {} and {}: they overlap", index,
                                    old->second.second.filename().string(), path.filename().string()));
      at = end + 1;
    }
  }
  std::size_t missing = 0, first_missing = 0;
  for (std::size_t i = 0; i < manifest.runs; ++i) {
    if (lines.contains(i)) continue;
    if (missing++ == 0) first_missing = i;
  }
  if (missing > 0)
    throw UserError(
        fmt::format("{}: {} of {} runs are missing, the first is {}; run the shards that are not "
                    "finished (or were not begun) once more",
                    folder.string(), missing, manifest.runs, first_missing));
  if (lines.size() != manifest.runs)
    throw UserError(fmt::format("{}: {} runs where {} belong", folder.string(), lines.size(), manifest.runs));
  std::string table = "# " + manifest.text + '\n' + table_columns() + '\n';
  std::vector<Row> rows;
  rows.reserve(lines.size());
  for (const auto& [index, line] : lines) {
    table += line.first + '\n';
    rows.push_back(parse_row(line.first));
  }
  const fs::path path = folder / "runs.csv";
  if (fs::exists(path)) {
    if (slurp(path) != table)
      throw UserError(path.string() + ": is there and says something else; it was left as it is");
    return rows;
  }
  const fs::path mine = folder / fmt::format(".runs-{}", ::getpid());
  std::ofstream out(mine, std::ios::binary);
  out << table;
  out.close();
  if (!out) throw RunError(mine.string() + ": cannot be written");
  fs::rename(mine, path);
  return rows;
}

}  // namespace telenano::studies::stress

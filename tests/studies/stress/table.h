#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "tests/studies/stress/stress_run.h"

namespace telenano::studies::stress {

/// A row of a table: what was run and what came of it.
struct Row {
  std::size_t index = 0;  ///< in the profile
  RunSpec spec;
  Outcome outcome;
};

/// Names of the columns, comma-separated, and a row; numbers as short as they can be read back to the bit,
/// what does not apply empty. No line end.
std::string table_columns();
std::string to_csv(const Row& row);
/// Throws RunError naming what is wrong.
Row parse_row(const std::string& line);

struct Shard {
  std::size_t number = 0, of = 1;
  bool holds(std::size_t index) const noexcept { return index % of == number; }
};

/// What a folder's tables are: made by the first that writes there, the same for all who add to it. `text` is
/// one line (profile, seed, commit, version, number of runs).
struct Manifest {
  std::string text;
  std::size_t runs = 0;
};

/// The growing table of one shard, DIR/shards/I-of-N.csv: rows in the order of their index, only ever
/// appended to, resumed after the last whole row.
class ShardTable {
 public:
  /// Throws UserError if the folder or the file belongs to another profile, seed, commit or version, if
  /// another process is writing it, or if it cannot be written.
  /// `wait`: while another process is writing it, wait until that one is done or dead.
  ShardTable(const std::filesystem::path& folder, const Manifest& manifest, const Shard& shard,
             bool wait = false);
  ~ShardTable();
  ShardTable(const ShardTable&) = delete;
  ShardTable& operator=(const ShardTable&) = delete;

  std::size_t rows() const noexcept { return rows_; }           ///< that were there
  bool dropped_half_line() const noexcept { return dropped_; }  ///< a process was killed while writing it
  void append(const Row& row);
  void sync();
  const std::filesystem::path& path() const noexcept { return path_; }

 private:
  std::filesystem::path path_;
  int file_ = -1;
  std::size_t rows_ = 0;
  bool dropped_ = false;
};

/// Reads the shards of a folder, which must be whole and belong together, and writes DIR/runs.csv: the same
/// bits whatever the number of shards. Throws UserError: gaps, overlaps, half-written or foreign shards; a
/// runs.csv that says something else. Returns all rows.
std::vector<Row> merge(const std::filesystem::path& folder);

/// The manifest of a folder. Throws UserError if there is none.
Manifest read_manifest(const std::filesystem::path& folder);

}  // namespace telenano::studies::stress

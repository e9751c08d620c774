#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "tests/studies/stress/table.h"

namespace telenano::studies::stress {

/// How long a shard took, for people: DIR/timings/I-of-N.csv, a line for each process that worked on it.
struct Timing {
  std::size_t runs = 0;
  std::int64_t ticks = 0;
  double seconds = 0;
  unsigned threads = 1;
};
void note_timing(const std::filesystem::path& folder, const Shard& shard, const Timing& timing);

/// All of a folder's together: "24 071 runs …, 905 s on 2 threads"; empty if nothing was noted.
std::string timing_text(const std::filesystem::path& folder);

/// A row for each method, scene and hand: what a whole table says in some tens of kilobytes.
std::string groups_csv(const std::vector<Row>& rows);

/// What of a finished sweep is worth keeping: its page, its rows summed up by method (summary.csv) and by
/// method, scene and hand (groups.csv), the runs that broke a promise (broken.csv), and where it was made
/// (run.txt). Throws UserError if `results` cannot be written.
void keep_results(const std::filesystem::path& folder, const std::vector<Row>& rows,
                  const std::filesystem::path& results);

}  // namespace telenano::studies::stress

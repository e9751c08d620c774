#pragma once

#include <filesystem>
#include <vector>

#include "tests/studies/stress/profile.h"
#include "tests/studies/stress/table.h"

namespace telenano::studies::stress {

struct SweepOptions {
  ProfileOptions profile;
  std::filesystem::path out = "stress";
  std::filesystem::path scenes;  ///< folder of the scenes' files
  Shard shard;
  unsigned threads = 0;  ///< 0: one a core
  bool wait = false;     ///< for another process that writes this shard
  bool quiet = false;    ///< no progress on standard error
};

/// What makes tables belong together: profile, seed, version, commit, number of runs.
Manifest manifest_of(const ProfileOptions& options, std::size_t runs);

struct SweepResult {
  std::size_t runs = 0;      ///< of this shard, those found included
  std::size_t computed = 0;  ///< now
  std::int64_t ticks = 0;    ///< computed now
  double seconds = 0;        ///< it took
  unsigned threads = 1;
};

/// Computes what is missing of a shard and appends it to its table. Rows are independent of the number of
/// threads; one of kRepeatEvery is computed twice and must come out the same.
SweepResult sweep(const SweepOptions& options);

constexpr std::size_t kRepeatEvery = 97;

/// Rows that break what their method promises.
std::vector<const Row*> broken_promises(const std::vector<Row>& rows);

}  // namespace telenano::studies::stress

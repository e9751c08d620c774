#pragma once

#include <vector>

#include "tests/studies/bench/result_rows.h"

namespace telenano::studies {

/// Command and reply to bytes and back, beside copying the packed structs. `rounds` blocks of each, in turn.
std::vector<BenchRow> run_codec_bench(int rounds);

}  // namespace telenano::studies

#include <gtest/gtest.h>

#include <cstddef>
#include <filesystem>
#include <fstream>
#include <string>

#include "tests/source_dir.h"
#include "tests/studies/stress/hunt.h"
#include "tests/studies/stress/invariants.h"
#include "tests/studies/stress/mutants.h"
#include "tests/studies/stress/run_spec.h"
#include "tests/studies/stress/scenes.h"
#include "tests/studies/stress/stress_run.h"

namespace telenano::studies::stress {
namespace {

// The worst that was ever found, shrunk, for ever: a trace with a mutant must still find it out, and without
// the mutant, as every other trace, nothing that is promised may be broken.
TEST(Traces, TheWorstThatWasFoundIsHarmlessAndFaultsAreStillFound) {
  const auto folder = std::filesystem::path(TELENANO_SOURCE_DIR) / "tests/studies/stress/traces";
  std::size_t traces = 0, mutants = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.path().extension() != ".trace") continue;
    std::ifstream in(entry.path());
    for (std::string line; std::getline(in, line);) {
      if (line.empty() || line[0] == '#') continue;
      ++traces;
      const RunSpec spec = parse_run_spec(line);
      RunSpec right = spec;
      right.mutant = Mutant::kNone;
      const Outcome outcome = run(right, Scenes::of_this_tree());
      EXPECT_EQ(outcome.violated & promised(right.method), 0u)
          << entry.path() << ": " << invariant_names(outcome.violated & promised(right.method));
      if (spec.mutant == Mutant::kNone) continue;
      ++mutants;
      EXPECT_NE(run(spec, Scenes::of_this_tree()).violated & ~outcome.violated, 0u)
          << entry.path() << ": the wrong controller is not found out any more";
    }
  }
  EXPECT_GE(traces, 20u);
  EXPECT_GE(mutants, kMutants);
}

}  // namespace
}  // namespace telenano::studies::stress

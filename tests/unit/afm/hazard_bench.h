#pragma once

#include <gtest/gtest.h>

#include <utility>
#include <vector>

#include "tests/unit/afm/afm_bench.h"

namespace telenano::afm {

inline void ask(Bench& b, nanonis::CommandId id, std::vector<double> numbers) {
  b.afm->controller().begin({id, std::move(numbers)}, -1, b.afm->now_ns());
}

/// Withdrawn by the logic itself, at a force that the limit and some steps of one reading explain.
inline void expect_withdrawn(Bench& b, double steps) {
  EXPECT_TRUE(b.afm->controller().withdrawn());
  EXPECT_EQ(b.afm->controller().safe_tips(), 0u) << "by the logic, not by the controller";
  EXPECT_LE(b.afm->controller().tip().peak_force_nn(),
            b.config.force_max_nn + steps * b.config.spring_constant_n_m * b.config.step_nm)
      << b.afm->logic().news();
}

}  // namespace telenano::afm

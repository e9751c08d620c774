#include "tests/studies/bench/result_rows.h"

#include <fmt/format.h>

#include <cstdio>

namespace telenano::studies {

void print_rows(const std::string& bench, const std::vector<BenchRow>& rows) {
  fmt::print("bench,case,quantity,product,floor,ratio,target,holds\n");
  for (const BenchRow& row : rows) {
    const auto or_nothing = [](const std::optional<double>& v) { return v ? fmt::format("{:.4g}", *v) : ""; };
    const std::string ratio = row.floor ? fmt::format("{:.3f}", measure_of(row)) : "";
    const std::string verdict = !row.target ? "" : holds(row) ? "yes" : "no";
    fmt::print("{},{},{},{:.4g},{},{},{},{}\n", bench, row.what, row.quantity, row.product,
               or_nothing(row.floor), ratio, or_nothing(row.target), verdict);
    if (!row.target || holds(row)) continue;
    fmt::print(stderr, "telenano-lab: {} {} {}: {:.3f}, target {} {:g}: missed\n", bench, row.what,
               row.quantity, measure_of(row), row.at_least ? "at least" : "at most", *row.target);
  }
}

}  // namespace telenano::studies

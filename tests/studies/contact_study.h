#pragma once

#include <cstdio>
#include <string>
#include <vector>

namespace telenano::studies {

/// What `telenano-lab contact` is asked for.
struct ContactOptions {
  std::string law = "md";
  std::vector<double> lambda;
  std::vector<double> delta;
  bool retract = false;  ///< start in deep contact instead of far away
  bool points = false;   ///< print the curve's special points instead of the curve
};

/// Pure Maugis–Dugdale under displacement control, dimensionless, as CSV with 15 significant digits. For
/// every lambda afresh, the overlap moves continuously from value to value of `delta`, so that jumps between
/// them are not missed. Throws UserError if the options make no sense, before anything is printed.
void run_contact(const ContactOptions& options, std::FILE* out);

}  // namespace telenano::studies

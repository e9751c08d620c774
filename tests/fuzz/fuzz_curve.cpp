// Any bytes as a force curve: one clear line, or finite numbers in both ways; and what is made of them before
// a fit.
#include <cmath>

#include "fuzz_input.h"
#include "telenano/nve_server/fit/curve_file.h"
#include "telenano/nve_server/fit/prepared_curve.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telenano;
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  FUZZ_CHECK(fit::curves_in(bytes) >= 1 && fit::curves_in(bytes) <= fit::kCurvesMax);
  const fit::RawCurve curve = fit::read_curve(bytes);
  if (!curve.error.empty()) {
    fuzz::check_error_line(curve.error);
    return 0;
  }
  for (const fit::RawSegment* segment : {&curve.approach, &curve.retract}) {
    FUZZ_CHECK(segment->z_nm.size() == segment->deflection.size());
    FUZZ_CHECK(segment->z_nm.size() >= fit::kPointsMin && segment->z_nm.size() <= fit::kPointsMax);
    for (const double z : segment->z_nm) FUZZ_CHECK(std::isfinite(z));
    for (const double d : segment->deflection) FUZZ_CHECK(std::isfinite(d));
  }
  if (curve.approach.z_nm.size() + curve.retract.z_nm.size() > 8192) return 0;
  const fit::PreparedCurve prepared =
      fit::prepare(curve, {.stiffness_n_m = 0.2, .invols_nm_v = {}, .invols_from_stiff = (size & 1U) != 0});
  if (!prepared.error.empty()) {
    fuzz::check_error_line(prepared.error);
    return 0;
  }
  for (const fit::PreparedSegment* segment : {&prepared.approach, &prepared.retract}) {
    FUZZ_CHECK(segment->slope.size() == segment->z_nm.size());
    FUZZ_CHECK(segment->free_begin < segment->free_end && segment->free_end <= segment->z_nm.size());
    for (const double d : segment->deflection_nm) FUZZ_CHECK(std::isfinite(d));
    if (segment->leap)
      FUZZ_CHECK(segment->leap->before < segment->leap->after && segment->leap->after < segment->z_nm.size());
  }
  FUZZ_CHECK(prepared.noise_nm > 0 && prepared.noise.white > 0 && std::isfinite(prepared.noise.sigma()));
  return 0;
}

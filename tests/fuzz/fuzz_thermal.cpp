// Any bytes as a lever's thermal motion: one clear line, or a stiffness that is a number.
#include <cmath>

#include "fuzz_input.h"
#include "telenano/nve_server/fit/thermal_spectrum.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telenano;
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  const fit::Spectrum spectrum = fit::read_spectrum(bytes);
  if (!spectrum.error.empty()) {
    fuzz::check_error_line(spectrum.error);
    return 0;
  }
  FUZZ_CHECK(spectrum.frequency_hz.size() == spectrum.density.size());
  for (const double f : spectrum.frequency_hz) FUZZ_CHECK(std::isfinite(f) && f >= 0);
  for (const double p : spectrum.density) FUZZ_CHECK(std::isfinite(p) && p >= 0);
  fit::ThermalSetup setup;
  setup.invols_nm_v = 40.0;
  const fit::ThermalStiffness found = fit::stiffness_of(spectrum, setup);
  if (!found.error.empty()) {
    fuzz::check_error_line(found.error);
    return 0;
  }
  FUZZ_CHECK(std::isfinite(found.stiffness_n_m) && found.stiffness_n_m > 0);
  FUZZ_CHECK(std::isfinite(found.relative_error) && found.relative_error >= 0);
  FUZZ_CHECK(std::isfinite(found.frequency_hz) && std::isfinite(found.quality) && found.averages >= 1);
  return 0;
}

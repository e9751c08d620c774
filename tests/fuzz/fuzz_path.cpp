// Any text as a path for the tip: one clear line, or points whose times rise.
#include <cmath>

#include "fuzz_input.h"
#include "telenano/common/base/error.h"
#include "telenano/nve_server/app/scene/path_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telenano;
  try {
    const auto points = app::parse_path({reinterpret_cast<const char*>(data), size}, "path.csv");
    FUZZ_CHECK(!points.empty());
    for (std::size_t i = 0; i < points.size(); ++i) {
      FUZZ_CHECK(std::isfinite(points[i].t_s) && is_finite(points[i].end_w_nm));
      if (i > 0) FUZZ_CHECK(points[i].t_s > points[i - 1].t_s);
    }
  } catch (const UserError& error) {
    fuzz::check_error_line(error.what());
  }
  return 0;
}

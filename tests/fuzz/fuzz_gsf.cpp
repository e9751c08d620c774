// Any bytes as a scan: one clear line, or a grid that can be levelled and written and read again.
#include <cmath>

#include "fuzz_input.h"
#include "telenano/common/base/error.h"
#include "telenano/common/surface/gsf.h"
#include "telenano/nve_server/scene/levelling.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telenano;
  const std::string bytes(reinterpret_cast<const char*>(data), size);
  surface::Scan scan;
  try {
    scan = surface::parse_gsf(bytes, "scan.gsf");
  } catch (const UserError& error) {
    fuzz::check_error_line(error.what());
    return 0;
  }
  const auto& grid = scan.grid;
  FUZZ_CHECK(grid.z_nm.size() ==
             static_cast<std::size_t>(grid.rows) * static_cast<std::size_t>(grid.columns));
  double lowest_nm = INFINITY;
  for (const double z : grid.z_nm) {
    FUZZ_CHECK(std::isfinite(z) && z >= 0);
    lowest_nm = std::fmin(lowest_nm, z);
  }
  FUZZ_CHECK(lowest_nm == 0);

  const surface::Scan again = surface::parse_gsf(surface::format_gsf(scan, "out.gsf"), "out.gsf");
  FUZZ_CHECK(again.grid.rows == grid.rows && again.grid.columns == grid.columns && again.title == scan.title);
  FUZZ_CHECK(again.width_nm == scan.width_nm && again.height_nm == scan.height_nm);

  for (const char* how : {"plane", "lines"}) {
    physics::HeightGrid levelled = grid;
    scene::level(levelled, *scene::levelling_from_name(how));
    for (const double z : levelled.z_nm) FUZZ_CHECK(std::isfinite(z));
  }
  return 0;
}

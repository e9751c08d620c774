// Any bytes as a file of Gwyddion: one clear line, or channels whose numbers lie within the bytes; what a
// scene could be made of goes through all that import does to it.
#include <algorithm>
#include <cmath>

#include "fuzz_input.h"
#include "telenano/common/surface/gsf.h"
#include "telenano/nve_server/import/clean_scan.h"
#include "telenano/nve_server/import/gwy_file.h"
#include "telenano/nve_server/import/imported_scene.h"
#include "telenano/nve_server/import/tip_erosion.h"

namespace {

using namespace telenano;

void check_field(const import::GwyField& field, std::string_view bytes) {
  FUZZ_CHECK(field.columns >= 1 && field.rows >= 1);
  FUZZ_CHECK(field.count() == static_cast<std::size_t>(field.columns) * static_cast<std::size_t>(field.rows));
  FUZZ_CHECK(field.data.data() >= bytes.data());
  FUZZ_CHECK(field.data.data() + field.data.size() <= bytes.data() + bytes.size());
  for (const char c : field.unit_z + field.unit_xy) FUZZ_CHECK(static_cast<unsigned char>(c) >= 0x20);
}

void clean(const import::GwyChannel& channel) {
  const import::GwyField& field = channel.field;
  if (field.columns < 2 || field.rows < 2 || field.count() > 4096) return;
  surface::HeightGrid grid;
  grid.columns = field.columns;
  grid.rows = field.rows;
  grid.dx_nm = 1.5;
  grid.z_nm.resize(field.count());
  std::vector<bool> gap(field.count(), false);
  for (std::size_t i = 0; i < field.count(); ++i) {
    const double z = field.value(i);
    gap[i] = !(std::abs(z) <= 1e5) || (channel.mask && channel.mask->value(i) > 0.5);
    grid.z_nm[i] = gap[i] ? 0.0 : z;
  }
  if (!import::fill_gaps(grid, gap)) return;
  const std::size_t spikes = import::count_spikes(grid, 5.0);
  FUZZ_CHECK(import::remove_spikes(grid, 5.0) == spikes);
  import::subtract(grid, import::fit_plane(grid));
  for (const double z : grid.z_nm) FUZZ_CHECK(std::isfinite(z));
  const import::Erosion erosion = import::erode(grid, 10.0);
  FUZZ_CHECK(std::isfinite(erosion.misfit_rms_nm) && erosion.certain.size() == grid.z_nm.size());
  const double bluntest_nm = import::bluntest_radius_nm(grid, 6.0 * import::pixel_noise_nm(grid));
  FUZZ_CHECK(bluntest_nm >= 1.0 && bluntest_nm <= 1e4);
  surface::HeightGrid ground = grid;
  ground.z_nm = erosion.z_nm;
  const std::vector<double> again = import::dilate(ground, 10.0);
  // Rounding of heights of up to 1e5 nm, tilted.
  for (std::size_t i = 0; i < again.size(); ++i) FUZZ_CHECK(again[i] <= grid.z_nm[i] + 1e-6);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  const import::GwyFile file = import::read_gwy(bytes);
  if (!file.error.empty()) {
    fuzz::check_error_line(file.error);
    FUZZ_CHECK(file.channels.empty());
    return 0;
  }
  for (const import::GwyChannel& channel : file.channels) {
    for (const char c : channel.title) FUZZ_CHECK(static_cast<unsigned char>(c) >= 0x20);
    FUZZ_CHECK(import::plain_name(channel.title).find_first_of("/.\"\\ ") == std::string::npos);
    check_field(channel.field, bytes);
    if (channel.mask) check_field(*channel.mask, bytes);
    clean(channel);
  }
  return 0;
}

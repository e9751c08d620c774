// Any bytes as a scene bundle: one clear line, or a scene that is built, and written and read again as it is.
#include <cmath>
#include <cstdlib>
#include <functional>
#include <string>

#include "fuzz_input.h"
#include "telenano/common/base/error.h"
#include "telenano/nve_server/scene/scene_bundle.h"

namespace {

using namespace telenano;

double value_or(const scene::BundleParts& parts, const std::string& path, double otherwise) {
  for (const config::TomlValue& value : parts.values) {
    if (value.path != path) continue;
    if (const double* const number = std::get_if<double>(&value.value)) return *number;
    if (const auto* const integer = std::get_if<std::int64_t>(&value.value))
      return static_cast<double>(*integer);
  }
  return otherwise;
}

/// A grid of many points takes a thousand times as long as one of few and is no other.
bool has_many_points(const scene::BundleParts& parts) {
  constexpr double kFew = 24;
  const double half_width_nm = value_or(parts, "limits.half_width_nm", 150);
  const double radius_nm = value_or(parts, "probe.tip_radius_nm", 20);
  const double otherwise = std::fmin(1.0, radius_nm / 8);
  const double spacing_nm = std::fmin(value_or(parts, "surface.spacing_nm", otherwise),
                                      value_or(parts, "marks.spacing_nm", otherwise));
  return half_width_nm > kFew * spacing_nm;
}

}  // namespace

// Fields of scans that are made up here are not worth keeping.
[[maybe_unused]] const int kNoCache = ::setenv("TELENANO_CACHE", "off", 1);

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string bytes(reinterpret_cast<const char*>(data), size);
  try {
    const scene::BundleParts parts = scene::open_bundle(bytes);
    FUZZ_CHECK(parts.text.size() + parts.scan.size() <= size);
    if (has_many_points(parts) && std::hash<std::string>()(bytes) % 256 != 0) return 0;
    const auto built = scene::decode_bundle(bytes);
    FUZZ_CHECK(built->surface && built->level);
    FUZZ_CHECK(is_finite(built->start_apex_w_nm) && std::isfinite(built->start_touch_w_nm));
    FUZZ_CHECK((built->limits.workspace_min_w_nm.array() <= built->limits.workspace_max_w_nm.array()).all());
    FUZZ_CHECK(built->port_compliance_nm_nn().allFinite());
    scene::check_bundle_text(parts);
    // Where text and numbers agree, reading the text gives these very bytes; a scan's file is not here.
    if (parts.scan.empty()) FUZZ_CHECK(scene::parse_scene_with_bundle(parts.text, "again").bundle == bytes);
  } catch (const UserError& error) {
    fuzz::check_error_line(error.what());
  }
  return 0;
}

// Any text as one of the project's TOML files: a scene, a list of keys, a slave's limits or a station's
// settings. One clear line, or something that works.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <string>
#include <utility>

#include "fuzz_input.h"
#include "telenano/common/base/error.h"
#include "telenano/common/config/slave_limits_file.h"
#include "telenano/common/config/toml_document.h"
#include "telenano/common/security/key_list.h"
#include "telenano/master/app/station_file.h"
#include "telenano/nve_server/scene/scene.h"

namespace {

using namespace telenano;

/// A grid of many points takes a thousand times as long as reading its description, and is no other grid than
/// one of few. False where the description is wrong: that is seen before anything is built.
bool builds_many_points(const config::TomlTable& root) {
  constexpr double kFew = 24;  // points from the middle to the rim
  try {
    const std::string kind = root.table("surface").text("kind");
    const auto marks = root.optional_table("marks");
    if (kind != "step" && kind != "grating" && !root.table("sample").has("hardness_gpa")) return false;
    const double half_width_nm =
        root.table("limits").number_or("half_width_nm", config::between(1, 1e6), 150);
    const double radius_nm = root.table("probe").number("tip_radius_nm", config::between(1e-3, 1e6));
    const double spacing_nm =
        (marks ? *marks : root.table("surface"))
            .number_or("spacing_nm", config::between(0.05, 1e3), std::min(1.0, radius_nm / 8));
    return half_width_nm > kFew * spacing_nm;
  } catch (const UserError&) {
    return false;
  }
}

void read_as_what_it_looks_like(const std::string& text) {
  const config::TomlTable root = config::TomlDocument::parse(text, "file.toml").root();
  if (root.has("key") || root.has("certificate")) {
    const security::KeyList list = security::parse_key_list(text, "keys.toml");
    const security::KeyList again = security::parse_key_list(security::key_list_text(list), "keys.toml");
    FUZZ_CHECK(again.keys.size() == list.keys.size() &&
               again.certificates.size() == list.certificates.size());
  } else if (root.has("scene_hash")) {
    const config::SlaveLimits limits = config::parse_slave_limits(text, "limits.toml");
    const config::SlaveLimits again =
        config::parse_slave_limits(config::slave_limits_text(limits), "limits.toml");
    FUZZ_CHECK(again.start_pos_w_nm == limits.start_pos_w_nm && again.force_max_nn == limits.force_max_nn);
  } else if (root.has("sample") || root.has("surface")) {
    // Now and then all the same.
    if (builds_many_points(root) && std::hash<std::string>()(text) % 256 != 0) return;
    const auto scene = scene::parse_scene(text, "scene.toml");
    FUZZ_CHECK(scene->surface && scene->level);
    FUZZ_CHECK(is_finite(scene->start_apex_w_nm) && std::isfinite(scene->start_touch_w_nm));
    FUZZ_CHECK((scene->limits.workspace_min_w_nm.array() <= scene->limits.workspace_max_w_nm.array()).all());
    FUZZ_CHECK(scene->port_compliance_nm_nn().allFinite());
  } else {
    const app::StationFile file = app::parse_station_file(text, "station.toml");
    FUZZ_CHECK(file.text == text);
  }
}

}  // namespace

// Fields of scans that are made up here are not worth keeping.
[[maybe_unused]] const int kNoCache = ::setenv("TELENANO_CACHE", "off", 1);

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    read_as_what_it_looks_like({reinterpret_cast<const char*>(data), size});
  } catch (const UserError& error) {
    fuzz::check_error_line(error.what());
  }
  return 0;
}

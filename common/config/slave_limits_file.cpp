#include "telenano/common/config/slave_limits_file.h"

#include <array>
#include <charconv>
#include <fstream>
#include <utility>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/config/toml_document.h"

namespace telenano::config {
namespace {

/// The fewest digits that read back as the same number; TOML wants a point or an exponent in a float.
std::string number(double value) {
  std::array<char, 40> text{};
  std::string result(text.data(), std::to_chars(text.data(), text.data() + text.size(), value).ptr);
  if (result.find_first_of(".e") == std::string::npos) result += ".0";
  return result;
}

std::string vector(const Vec3& v) {
  std::string result(1, '[');
  result += number(v.x()) + ", " + number(v.y()) + ", " + number(v.z());
  result += ']';
  return result;
}

std::string quoted(const std::string& text) {
  std::string result(1, '"');
  for (const char c : text) {
    if (c == '"' || c == '\\') result += '\\';
    result += static_cast<unsigned char>(c) < 0x20 || c == 0x7f ? ' ' : c;
  }
  result += '"';
  return result;
}

Vec3 read_vector(const TomlTable& table, const char* key) {
  const std::vector<double> v = table.numbers(key, between(-1e9, 1e9), 3, 3);
  return {v[0], v[1], v[2]};
}

SlaveLimits read(const TomlDocument& document) {
  const TomlTable root = document.root();
  SlaveLimits limits;
  limits.scene_name = root.text("scene_name");
  limits.scene_hash = root.text("scene_hash");
  limits.workspace_min_w_nm = read_vector(root, "workspace_min_w_nm");
  limits.workspace_max_w_nm = read_vector(root, "workspace_max_w_nm");
  if (!((limits.workspace_max_w_nm - limits.workspace_min_w_nm).minCoeff() > 0))
    root.fail("workspace_max_w_nm", "expected more than workspace_min_w_nm on every axis");
  limits.start_pos_w_nm = read_vector(root, "start_pos_w_nm");
  limits.surface_z_w_nm = root.number("surface_z_w_nm", between(-1e9, 1e9));
  limits.force_max_nn = root.number("force_max_nn", positive());
  limits.coupling_stiffness_n_m = root.number("coupling_stiffness_n_m", positive());
  limits.coupling_damping_n_s_m = root.number("coupling_damping_n_s_m", at_least(0));
  limits.well_aj = root.number_or("well_aj", at_least(0), 0);
  limits.rate_max_hz = root.number("rate_max_hz", positive());
  document.finish();
  return limits;
}

}  // namespace

std::string slave_limits_text(const SlaveLimits& l) {
  return "# Limits of a slave, for telenano-master plan --limits\nscene_name = " + quoted(l.scene_name) +
         "\nscene_hash = " + quoted(l.scene_hash) + "\nworkspace_min_w_nm = " + vector(l.workspace_min_w_nm) +
         "\nworkspace_max_w_nm = " + vector(l.workspace_max_w_nm) +
         "\nstart_pos_w_nm = " + vector(l.start_pos_w_nm) + "\nsurface_z_w_nm = " + number(l.surface_z_w_nm) +
         "\nforce_max_nn = " + number(l.force_max_nn) +
         "\ncoupling_stiffness_n_m = " + number(l.coupling_stiffness_n_m) +
         "\ncoupling_damping_n_s_m = " + number(l.coupling_damping_n_s_m) +
         "\nwell_aj = " + number(l.well_aj) + "\nrate_max_hz = " + number(l.rate_max_hz) + "\n";
}

void write_slave_limits(const SlaveLimits& limits, const std::string& path) {
  std::ofstream out(path, std::ios::binary);
  out << slave_limits_text(limits);
  if (!out.flush()) throw RunError(path + ": cannot be written");
}

SlaveLimits load_slave_limits(const std::string& path) {
  return read(TomlDocument::load(path));
}

SlaveLimits parse_slave_limits(std::string content, const std::string& name) {
  return read(TomlDocument::parse(std::move(content), name));
}

}  // namespace telenano::config

#include "telenano/common/config/slave_limits_file.h"

#include <gtest/gtest.h>

#include <string>

#include "telenano/common/base/error.h"

namespace telenano::config {
namespace {

SlaveLimits some() {
  SlaveLimits limits;
  limits.scene_name = "a \"quoted\" \\ name";
  limits.scene_hash = "0123456789abcdef";
  limits.workspace_min_w_nm = Vec3(-500, -0.1, -60);
  limits.workspace_max_w_nm = Vec3(500, 1.0 / 3, 100);
  limits.start_pos_w_nm = Vec3(1e-17, 2, 20.165);
  limits.surface_z_w_nm = -0.0625;
  limits.force_max_nn = 500;
  limits.coupling_stiffness_n_m = 40.0 / 3;
  limits.well_aj = 1e3 / 7;
  limits.rate_max_hz = 8000;
  return limits;
}

// Shortest decimals read back as the same double: equal, not near.
TEST(SlaveLimitsFile, ReadsBackWhatWasWritten) {
  const SlaveLimits in = some();
  const SlaveLimits out = parse_slave_limits(slave_limits_text(in), "limits.toml");
  EXPECT_EQ(out.scene_name, in.scene_name);
  EXPECT_EQ(out.scene_hash, in.scene_hash);
  EXPECT_EQ(out.workspace_min_w_nm, in.workspace_min_w_nm);
  EXPECT_EQ(out.workspace_max_w_nm, in.workspace_max_w_nm);
  EXPECT_EQ(out.start_pos_w_nm, in.start_pos_w_nm);
  EXPECT_EQ(out.surface_z_w_nm, in.surface_z_w_nm);
  EXPECT_EQ(out.force_max_nn, in.force_max_nn);
  EXPECT_EQ(out.coupling_stiffness_n_m, in.coupling_stiffness_n_m);
  EXPECT_EQ(out.coupling_damping_n_s_m, in.coupling_damping_n_s_m);
  EXPECT_EQ(out.well_aj, in.well_aj);
  EXPECT_EQ(out.rate_max_hz, in.rate_max_hz);
}

TEST(SlaveLimitsFile, AFileFromBeforeThereWereWellsHasNone) {
  std::string text = slave_limits_text(some());
  const std::size_t at = text.find("well_aj");
  text.erase(at, text.find('\n', at) + 1 - at);
  EXPECT_EQ(parse_slave_limits(text, "limits.toml").well_aj, 0);
}

TEST(SlaveLimitsFile, RefusesWhatIsMissingUnknownOrWrong) {
  const auto message = [](const SlaveLimits& limits, const std::string& more) {
    try {
      parse_slave_limits(slave_limits_text(limits) + more, "limits.toml");
    } catch (const UserError& error) {
      return std::string(error.what());
    }
    return std::string("no error");
  };
  SlaveLimits limits = some();
  EXPECT_NE(message(limits, "force_max = 3.0\n").find("force_max"), std::string::npos);
  limits.force_max_nn = 0;
  EXPECT_NE(message(limits, "").find("force_max_nn"), std::string::npos);
  limits = some();
  limits.workspace_max_w_nm.z() = -60;
  EXPECT_NE(message(limits, "").find("workspace_max_w_nm"), std::string::npos);
  EXPECT_THROW(parse_slave_limits("scene_name = \"x\"\n", "limits.toml"), UserError);
  EXPECT_THROW(load_slave_limits("/nowhere/limits.toml"), UserError);
}

}  // namespace
}  // namespace telenano::config

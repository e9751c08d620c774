// Force curves as instruments write them, against what another program reads from the same bytes or what the
// files say about themselves; and files that are cut off or lie.
#include "telenano/nve_server/fit/curve_file.h"

#include <gtest/gtest.h>

#include <fstream>
#include <iterator>

#include "tests/source_dir.h"

namespace telenano::fit {
namespace {

std::string bytes_of(const std::string& name) {
  std::ifstream file(std::string(TELENANO_SOURCE_DIR) + "/tests/data/curves/" + name, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

// Values: struct and zipfile of Python on the same bytes.
TEST(CurveFile, IgorWave) {
  const RawCurve curve = read_curve(bytes_of("silicon_nitride.ibw"));
  ASSERT_EQ(curve.error, "");
  EXPECT_EQ(curve.unit, DeflectionUnit::kNanometre);
  EXPECT_EQ(curve.approach.z_nm.size() + curve.retract.z_nm.size(), 2016u);
  EXPECT_NEAR(static_cast<double>(curve.approach.z_nm.size()), 1009, 3);  // its note: "Indexes: 0,1008,2015"
  EXPECT_NEAR(curve.approach.z_nm[0], 1195.6911976, 1e-6);
  EXPECT_NEAR(curve.approach.deflection[0], -3.2724853938, 1e-9);
  EXPECT_NEAR(curve.approach.deflection[1000], 4.3877168565, 1e-9);
  EXPECT_NEAR(curve.stiffness_n_m.value_or(0), 1.1841, 1e-12);
  EXPECT_NEAR(curve.invols_nm_v.value_or(0), 44.99, 1e-9);
  const RawCurve raw = read_curve(bytes_of("silicon_nitride.ibw"), {.z = "raw", .deflection = ""});
  EXPECT_NEAR(raw.approach.z_nm[0], 1195.7095012, 1e-6);
}

TEST(CurveFile, JpkForce) {
  const RawCurve curve = read_curve(bytes_of("soft_sample.jpk-force"));
  ASSERT_EQ(curve.error, "");
  EXPECT_EQ(curve.unit, DeflectionUnit::kNanometre);
  EXPECT_EQ(curve.approach.z_nm.size(), 2000u);
  EXPECT_EQ(curve.retract.z_nm.size(), 2000u);
  EXPECT_NEAR(curve.stiffness_n_m.value_or(0), 0.043493666407368466, 1e-12);
  EXPECT_NEAR(curve.approach.deflection[0], -11.830640222775473, 1e-6);
  EXPECT_NEAR(curve.approach.z_nm[0], 22815.67243876861, 1e-6);
}

TEST(CurveFile, TableWithAPairOfColumnsForEachWay) {
  const RawCurve curve = read_curve(bytes_of("afm_workshop.csv"));
  ASSERT_EQ(curve.error, "");
  EXPECT_EQ(curve.unit, DeflectionUnit::kNanonewton);
  EXPECT_EQ(curve.approach.z_nm[0], 4129.0327);
  EXPECT_EQ(curve.approach.deflection[0], 0.0531);
  EXPECT_EQ(curve.retract.z_nm[0], 5345.0327);
  EXPECT_EQ(curve.retract.deflection[1], 0.0707);
}

std::string rows(const char* between, int n) {
  std::string text;
  for (int i = 0; i < n; ++i)
    text += std::to_string(i < n / 2 ? n - i : i) + between + std::to_string(0.5 * i) + "\n";
  return text;
}

TEST(CurveFile, UnitsStandInTheColumnsNames) {
  const RawCurve volts = read_curve("made by hand\nz (um);Deflection [mV]\n" + rows(";", 60));
  ASSERT_EQ(volts.error, "");
  EXPECT_EQ(volts.unit, DeflectionUnit::kVolt);
  EXPECT_EQ(volts.approach.z_nm[0], 60e3);
  EXPECT_EQ(volts.approach.deflection[1], 0.5e-3);
  EXPECT_NE(read_curve("z,deflection\n" + rows(",", 60)).error.find("height"), std::string::npos);
  EXPECT_NE(read_curve("z_nm,deflection\n" + rows(",", 60)).error.find("without a unit"), std::string::npos);
  const ColumnChoice other{.z = "a nm", .deflection = "b nN"};
  EXPECT_EQ(read_curve("a nm,b nN\n" + rows(",", 60), other).unit, DeflectionUnit::kNanonewton);
}

void expect_one_line(const std::string& bytes) {
  const RawCurve curve = read_curve(bytes);
  if (curve.error.empty()) {
    EXPECT_EQ(curve.approach.z_nm.size(), curve.approach.deflection.size());
    EXPECT_GE(curve.approach.z_nm.size(), kPointsMin);
    return;
  }
  EXPECT_EQ(curve.error.find('\n'), std::string::npos);
  for (const char c : curve.error) EXPECT_TRUE(c >= 0x20 && c <= 0x7e);
}

TEST(CurveFile, CutOffAnywhere) {
  for (const char* name : {"silicon_nitride.ibw", "soft_sample.jpk-force", "afm_workshop.csv"}) {
    const std::string bytes = bytes_of(name);
    for (std::size_t n = 0; n < bytes.size(); n += n < 600 ? 1 : 997) expect_one_line(bytes.substr(0, n));
  }
  EXPECT_NE(read_curve(bytes_of("silicon_nitride.ibw").substr(0, 20000)).error.find("cut off"),
            std::string::npos);
  EXPECT_NE(read_curve(bytes_of("soft_sample.jpk-force").substr(0, 20000)).error.find("zip"),
            std::string::npos);
}

TEST(CurveFile, ChangedBytes) {
  for (const char* name : {"silicon_nitride.ibw", "soft_sample.jpk-force"}) {
    const std::string bytes = bytes_of(name);
    for (std::size_t i = 0; i < bytes.size(); i += i < 400 || i + 1500 > bytes.size() ? 1 : 211) {
      std::string changed = bytes;
      changed[i] = static_cast<char>(changed[i] ^ 0xff);
      expect_one_line(changed);
    }
  }
}

}  // namespace
}  // namespace telenano::fit

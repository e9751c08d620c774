// Force curves as instruments write them, against what another program reads from the same bytes or what the
// files say about themselves; and files that are cut off or lie.
#include "telenano/nve_server/fit/curve_file.h"

#include <gtest/gtest.h>

#include <algorithm>
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

// `telenano-master export --what curves` numbers its segments and says the way of each.
TEST(CurveFile, TheWayCountsWhereSegmentsAreNumbered) {
  std::string text = "segment,way,time_s,target_height_nm,deflection_nm\n";
  for (int i = 0; i < 80; ++i) {
    const int height = i < 40 ? 40 - i : i - 40;
    text += std::string(i < 40 ? "2,approach," : "3,retract,") + std::to_string(i) + "," +
            std::to_string(height) + ",0\n";
  }
  const RawCurve curve = read_curve(text, {.z = "target_height_nm", .deflection = ""});
  ASSERT_TRUE(curve.error.empty()) << curve.error;
  ASSERT_EQ(curve.approach.z_nm.size(), 40u);
  EXPECT_EQ(curve.approach.z_nm.front(), 40);
  EXPECT_EQ(curve.retract.z_nm.size(), 40u);
}

// What make_curves.py writes with h5py: chunks, deflate, shuffle, checksums; force with and without a lever.
TEST(CurveFile, Hdf5OfAfmformats) {
  const std::string bytes = bytes_of("made_packed.h5");
  EXPECT_EQ(curves_in(bytes), 2u);
  const RawCurve curve = read_curve(bytes);
  ASSERT_EQ(curve.error, "");
  EXPECT_EQ(curve.unit, DeflectionUnit::kNanometre);
  EXPECT_EQ(curve.stiffness_n_m.value_or(0), 0.05);
  EXPECT_NEAR(curve.invols_nm_v.value_or(0), 80, 1e-12);
  ASSERT_EQ(curve.approach.z_nm.size(), 120u);
  ASSERT_EQ(curve.retract.z_nm.size(), 60u);
  for (std::size_t i = 0; i < 120; ++i) {
    const auto step = static_cast<double>(i);
    EXPECT_NEAR(curve.approach.z_nm[i], 3000 - step, 1e-9);
    EXPECT_NEAR(curve.approach.deflection[i], 1e-3 * step * step / 0.05, 1e-9);
  }
  EXPECT_NEAR(curve.retract.z_nm[59], 3000 - 119 + 120, 1e-9);
  EXPECT_NEAR(curve.retract.deflection[59], -0.59 / 0.05, 1e-9);
  const RawCurve second = read_curve(bytes, {.z = "", .deflection = "", .number = 1});
  ASSERT_EQ(second.error, "");
  EXPECT_EQ(second.unit, DeflectionUnit::kNanonewton);
  EXPECT_NEAR(second.approach.deflection[100], 20, 1e-9);
  EXPECT_NE(read_curve(bytes, {.z = "", .deflection = "", .number = 2}).error.find("has 2 curves"),
            std::string::npos);
  EXPECT_NE(read_curve(bytes, {.z = "tip", .deflection = ""}).error.find("time"), std::string::npos);
}

TEST(CurveFile, Hdf5InOneBlockWithoutSegments) {
  const RawCurve curve = read_curve(bytes_of("made_plain.h5"));  // float32, high byte first
  ASSERT_EQ(curve.error, "");
  EXPECT_EQ(curve.approach.z_nm.size(), 120u);
  EXPECT_EQ(curve.retract.z_nm.size(), 60u);
  EXPECT_NEAR(curve.approach.deflection[100], 200, 2e-5);
  const std::string many = bytes_of("made_many.h5");
  EXPECT_EQ(curves_in(many), 12u);  // more than one node of names
  const RawCurve tenth = read_curve(many, {.z = "", .deflection = "", .number = 9});
  ASSERT_EQ(tenth.error, "");
  EXPECT_NEAR(tenth.approach.deflection[20], 10 * 0.4, 1e-9);
}

// Values: h5py on the same bytes.
TEST(CurveFile, Hdf5OfARealInstrument) {
  const RawCurve curve = read_curve(bytes_of("cell_hesion.h5"));
  ASSERT_EQ(curve.error, "");
  EXPECT_EQ(curve.approach.z_nm.size(), 5396u);
  EXPECT_EQ(curve.retract.z_nm.size(), 2400u);
  EXPECT_NEAR(curve.stiffness_n_m.value_or(0), 0.02230065831827453, 1e-15);
  EXPECT_NEAR(curve.invols_nm_v.value_or(0), 91.20708714532604, 1e-9);
  EXPECT_NEAR(curve.approach.z_nm[0], 66379.8944, 1e-3);
  EXPECT_NEAR(curve.approach.deflection[0], -7.36223288e-1 / 0.02230065831827453, 1e-6);
  EXPECT_NEAR(curve.retract.z_nm[2399], 69306.4881, 1e-3);
  EXPECT_NEAR(curve.retract.deflection[2399], -7.83813621e-1 / 0.02230065831827453, 1e-6);
  const RawCurve piezo =
      read_curve(bytes_of("cell_hesion.h5"), {.z = "height (piezo)", .deflection = "force"});
  EXPECT_NEAR(piezo.approach.z_nm[0], 48831.6767, 1e-3);
}

TEST(CurveFile, NanoscopeOfVersion5WithARampOnly) {
  const RawCurve curve = read_curve(bytes_of("made_5.000"));
  ASSERT_EQ(curve.error, "");
  EXPECT_EQ(curve.unit, DeflectionUnit::kVolt);
  EXPECT_EQ(curve.stiffness_n_m.value_or(0), 0.06);
  EXPECT_EQ(curve.invols_nm_v.value_or(0), 51.25);
  ASSERT_EQ(curve.approach.z_nm.size(), 88u);  // 12 were not measured
  ASSERT_EQ(curve.retract.z_nm.size(), 100u);
  // 12.5 V of 20 nm/V over 100 points; the approach ends where the retract begins.
  EXPECT_NEAR(curve.approach.z_nm.front() - curve.approach.z_nm.back(), 87 * 2.5, 1e-9);
  EXPECT_EQ(curve.approach.z_nm.back(), curve.retract.z_nm.front());
  EXPECT_NEAR(curve.retract.z_nm[99], 99 * 2.5, 1e-9);
  EXPECT_EQ(curve.approach.deflection.front(), 0.0);
  EXPECT_NEAR(curve.approach.deflection.back(), 0.39, 0.5 * 0.000375);
  EXPECT_NEAR(curve.retract.deflection.front(), 0.39, 0.5 * 0.000375);
  EXPECT_NEAR(curve.retract.deflection[75], -0.05, 0.5 * 0.000375);
}

TEST(CurveFile, NanoscopeOfVersion9WithASensor) {
  const RawCurve curve = read_curve(bytes_of("made_9.spm"));
  ASSERT_EQ(curve.error, "");
  EXPECT_EQ(curve.stiffness_n_m.value_or(0), 40);
  EXPECT_EQ(curve.invols_nm_v.value_or(0), 30.5);
  ASSERT_EQ(curve.approach.z_nm.size(), 100u);
  for (std::size_t i = 0; i < 100; ++i) {
    const auto step = static_cast<double>(i);
    EXPECT_NEAR(curve.approach.z_nm[i], 500 - 2 * step, 1e-6);
    EXPECT_NEAR(curve.retract.z_nm[i], 302 + 2.5 * step, 1e-6);
    EXPECT_NEAR(curve.approach.deflection[i], 0.01 * std::max(0.0, step - 60), 1e-8);
  }
  EXPECT_NE(
      read_curve(bytes_of("made_9.spm"), {.z = "", .deflection = "friction"}).error.find("heightsensor"),
      std::string::npos);
}

TEST(CurveFile, ANanoscopeImageIsNoCurve) {
  const std::string end = "\\*File list end\r\n\x1a";
  EXPECT_NE(read_curve("\\*File list\r\n\\*Ciao image list\r\n" + end).error.find("telenano-nve import"),
            std::string::npos);
  std::string volume = bytes_of("made_5.000");
  volume.replace(volume.find("Data length: 400"), 16, "Data length: 1600");
  EXPECT_NE(read_curve(volume).error.find("force volume"), std::string::npos);
}

TEST(CurveFile, AChangedChunkIsFoundByItsChecksum) {
  const std::string bytes = bytes_of("cell_hesion.h5");
  ASSERT_EQ(read_curve(bytes).error, "");
  std::size_t refused = 0;
  for (std::size_t at = 12000; at < 200000; at += 1009) {
    std::string changed = bytes;
    changed[at] = static_cast<char>(changed[at] ^ 0x10);
    const RawCurve curve = read_curve(changed);
    refused += curve.error.find("damaged chunk") != std::string::npos ? 1 : 0;
  }
  // Force and height are two of five columns, most of what is not packed well.
  EXPECT_GT(refused, 30u);
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

TEST(CurveFile, TablesAsSpreadsheetsWriteThem) {
  const auto table = [](const std::string& begin, char by, char point, const std::string& end) {
    std::string text = begin + "z_nm" + by + "deflection_nm" + end;
    for (int i = 0; i < 100; ++i) {
      const int z = i < 50 ? 100 - 2 * i : 2 * i - 98;
      text += std::to_string(z) + point + "25" + by + "-0" + point + std::to_string(i + 10) + end;
    }
    return read_curve(text);
  };
  const RawCurve plain = table("", ',', '.', "\n");
  ASSERT_EQ(plain.error, "");
  EXPECT_EQ(plain.approach.z_nm.front(), 100.25);
  EXPECT_EQ(plain.approach.deflection.front(), -0.1);
  const RawCurve others[] = {table("", ';', ',', "\n"), table("", '\t', ',', "\r\n"),
                             table("\xef\xbb\xbf", ';', '.', "\r\n"), table("\xef\xbb\xbf", ',', '.', "\r")};
  for (const RawCurve& other : others) {
    EXPECT_EQ(other.error, "");
    EXPECT_EQ(other.approach.z_nm, plain.approach.z_nm);
    EXPECT_EQ(other.approach.deflection, plain.approach.deflection);
    EXPECT_EQ(other.retract.z_nm, plain.retract.z_nm);
  }
  EXPECT_NE(table("", ',', ',', "\n").error, "");  // nobody can tell these apart
}

TEST(CurveFile, CutOffAnywhere) {
  for (const char* name : {"silicon_nitride.ibw", "soft_sample.jpk-force", "afm_workshop.csv",
                           "made_packed.h5", "made_plain.h5", "made_5.000", "made_9.spm"}) {
    const std::string bytes = bytes_of(name);
    for (std::size_t n = 0; n < bytes.size(); n += n < 600 ? 1 : 997) expect_one_line(bytes.substr(0, n));
  }
  EXPECT_NE(read_curve(bytes_of("silicon_nitride.ibw").substr(0, 20000)).error.find("cut off"),
            std::string::npos);
  EXPECT_NE(read_curve(bytes_of("soft_sample.jpk-force").substr(0, 20000)).error.find("zip"),
            std::string::npos);
}

TEST(CurveFile, ChangedBytes) {
  for (const char* name :
       {"silicon_nitride.ibw", "soft_sample.jpk-force", "made_packed.h5", "made_plain.h5", "made_9.spm"}) {
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

// The oracle is the documentation of the format (tests/support/gwy_bytes.h writes by it), and a file that
// Gwyddion itself wrote.
#include "telenano/nve_server/import/gwy_file.h"

#include <gtest/gtest.h>

#include <fstream>
#include <iterator>

#include "tests/source_dir.h"
#include "tests/support/gwy_bytes.h"

namespace telenano::import {
namespace {

namespace gwy = support::gwy;

gwy::Field small() {
  return {3, 2, 30e-9, 10e-9, {1e-9, 2e-9, 3e-9, 4e-9, 5e-9, 6e-9}};
}

TEST(GwyFile, ReadsChannelsByNumberWithTitleUnitsAndMask) {
  gwy::Field phase = small();
  phase.unit_z = "deg";
  gwy::Field mask = small();
  mask.values = {0, 1, 0, 0, 0, 1};
  mask.unit_z = "";
  // Of every type that the format has; none of them is wanted.
  const std::string other =
      gwy::component("/0/data/visible", 'b', "\1") + gwy::component("/0/a", 'c', "x") +
      gwy::component("/0/b", 'q', gwy::raw(std::int64_t{-1})) +
      gwy::component("/0/c", 'C', gwy::raw(2u) + "ab") +
      gwy::component("/0/d", 'I', gwy::raw(2u) + gwy::raw(1) + gwy::raw(2)) +
      gwy::component("/0/e", 'Q', gwy::raw(1u) + gwy::raw(std::int64_t{5})) +
      gwy::component("/0/f", 'S', gwy::raw(2u) + gwy::text("one") + gwy::text("")) +
      gwy::component("/0/g", 'O', gwy::raw(2u) + gwy::unit("V") + gwy::object("Nothing", "")) +
      gwy::component("/filename", 's', gwy::text("/home/me/12/data"));
  const std::string bytes = gwy::file(
      other + gwy::channel(12, "Phase", phase) + gwy::component("/3/mask", 'o', gwy::field(mask)) +
      gwy::channel(3, "Height \x1b[31m", small()) + gwy::component("/3/data/title/x", 's', gwy::text("no")));
  const GwyFile file = read_gwy(bytes);
  ASSERT_EQ(file.error, "");
  ASSERT_EQ(file.channels.size(), 2u);
  const GwyChannel& height = file.channels[0];
  EXPECT_EQ(height.number, 3);
  EXPECT_EQ(height.title, "Height ?[31m");  // no orders to a terminal
  EXPECT_EQ(height.field.columns, 3);
  EXPECT_EQ(height.field.rows, 2);
  EXPECT_EQ(height.field.width, 30e-9);
  EXPECT_EQ(height.field.height, 10e-9);
  EXPECT_EQ(height.field.unit_xy, "m");
  EXPECT_EQ(height.field.unit_z, "m");
  ASSERT_EQ(height.field.count(), 6u);
  for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(height.field.value(i), small().values[i]) << i;
  ASSERT_TRUE(height.mask);
  EXPECT_EQ(height.mask->value(1), 1.0);
  EXPECT_EQ(height.mask->value(2), 0.0);
  EXPECT_EQ(file.channels[1].number, 12);
  EXPECT_EQ(file.channels[1].field.unit_z, "deg");
  EXPECT_FALSE(file.channels[1].mask);
}

TEST(GwyFile, ReadsWhatGwyddionWrote) {
  const std::string path = std::string(TELENANO_SOURCE_DIR) + "/tests/data/import/asymmetric.gwy";
  std::ifstream in(path, std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
  const GwyFile file = read_gwy(bytes);
  ASSERT_EQ(file.error, "") << path;
  ASSERT_EQ(file.channels.size(), 1u);
  const GwyField& field = file.channels[0].field;
  EXPECT_EQ(file.channels[0].title, "Asymmetric height");
  EXPECT_EQ(field.columns, 4);
  EXPECT_EQ(field.rows, 3);
  EXPECT_EQ(field.width, 40e-9);
  EXPECT_EQ(field.height, 15e-9);
  EXPECT_EQ(field.unit_xy, "m");
  EXPECT_EQ(field.unit_z, "m");
  // tests/data/import/README.md: the float32 nearest to i nanometres, i from 1 to 12, rows from the top.
  for (std::size_t i = 0; i < 12; ++i)
    EXPECT_EQ(field.value(i), static_cast<double>(static_cast<float>(1e-9 * static_cast<double>(i + 1))))
        << i;
}

TEST(GwyFile, EveryCutIsOneLine) {
  const std::string whole = gwy::file(gwy::channel(0, "Height", small()));
  ASSERT_EQ(read_gwy(whole).error, "");
  for (std::size_t size = 0; size < whole.size(); ++size) {
    const GwyFile file = read_gwy(std::string_view(whole).substr(0, size));
    EXPECT_NE(file.error, "") << size;
    EXPECT_EQ(file.error.find('\n'), std::string::npos) << size;
    EXPECT_TRUE(file.channels.empty()) << size;
  }
}

TEST(GwyFile, AValueOfAByteLessIsCut) {
  // In a container whose own size is right.
  const std::string seven(7, '\1');
  for (const auto& [type, value] : {std::pair('b', std::string()),
                                    {'i', seven.substr(0, 3)},
                                    {'d', seven},
                                    {'q', seven},
                                    {'D', gwy::raw(1u) + seven},
                                    {'I', gwy::raw(2u) + seven},
                                    {'C', gwy::raw(8u) + seven},
                                    {'s', seven},
                                    {'S', gwy::raw(1u) + seven},
                                    {'o', gwy::text("x") + gwy::raw(8u) + seven},
                                    {'D', seven.substr(0, 3)}}) {
    EXPECT_EQ(
        read_gwy(gwy::file(gwy::component("/0/x", type, value))).error,
        "is truncated or damaged: in its container a component '/0/x' is longer than what is left of it")
        << type;
  }
}

TEST(GwyFile, SizesAreHeldAgainstWhatIsLeft) {
  // Every four bytes of a file, as if they were a size: the largest, one more, one less than is there.
  const std::string whole = gwy::file(gwy::component("/0/f", 'S', gwy::raw(1u) + gwy::text("s")) +
                                      gwy::component("/0/g", 'O', gwy::raw(1u) + gwy::unit("V")) +
                                      gwy::channel(0, "Height", small()));
  int refused = 0;
  for (std::size_t at = 4; at + 4 <= whole.size(); ++at) {
    std::uint32_t before = 0;
    std::memcpy(&before, whole.data() + at, 4);
    for (const std::uint32_t size : {0xffffffffu, 0x80000000u, 0x20000000u, before + 1, before - 1}) {
      std::string changed = whole;
      std::memcpy(changed.data() + at, &size, 4);
      const GwyFile file = read_gwy(changed);
      refused += file.error.empty() ? 0 : 1;
      for (const GwyChannel& channel : file.channels) {
        ASSERT_EQ(channel.field.count(), static_cast<std::size_t>(channel.field.columns) *
                                             static_cast<std::size_t>(channel.field.rows));
        ASSERT_LE(channel.field.data.data() + channel.field.data.size(), changed.data() + changed.size());
      }
    }
  }
  EXPECT_GT(refused, 500);
}

TEST(GwyFile, DepthCostsNoStack) {
  // Objects in objects, a hundred thousand deep: their sizes are right, so that all of it is a file.
  std::string head;
  std::vector<std::string> heads;
  constexpr int kDeep = 100'000;
  constexpr std::size_t kEach = 2 + 1 + 2 + 4;  // "x\0o" "y\0" size
  std::string nested;
  for (int i = 0; i < kDeep; ++i)
    nested += gwy::text("x") + "o" + gwy::text("y") +
              gwy::raw(static_cast<std::uint32_t>(kEach * static_cast<std::size_t>(kDeep - 1 - i)));
  EXPECT_EQ(read_gwy(gwy::file(nested)).error, "");
  const std::string in_a_field = gwy::component(
      "/0/data", 'o',
      gwy::object("GwyDataField", gwy::component("si_unit_z", 'o', gwy::object("GwySIUnit", nested))));
  EXPECT_EQ(read_gwy(gwy::file(in_a_field)).error, "/0/data lacks xres, yres or data");
}

TEST(GwyFile, EveryMistakeIsNamed) {
  EXPECT_EQ(read_gwy("GWYO and more").error, "is not a Gwyddion file: expected GWYP at its beginning");
  EXPECT_EQ(read_gwy("").error, "is not a Gwyddion file: expected GWYP at its beginning");
  EXPECT_EQ(read_gwy("GWYP" + gwy::object("GwyBrick", "")).error,
            "is damaged: expected a GwyContainer after GWYP");
  EXPECT_EQ(read_gwy(gwy::file(gwy::component("/0/x", '?', ""))).error,
            "is damaged: in its container the component '/0/x' has a type that the format does not know");
  gwy::Field wrong = small();
  wrong.columns = 4;
  EXPECT_EQ(read_gwy(gwy::file(gwy::channel(0, "", wrong))).error,
            "/0/data has 6 values, expected xres x yres = 4 x 2");
  wrong.columns = -3;
  wrong.rows = -2;  // whose product is right
  EXPECT_EQ(read_gwy(gwy::file(gwy::channel(0, "", wrong))).error,
            "/0/data has 6 values, expected xres x yres = -3 x -2");
  wrong = small();
  wrong.columns = 0x10000;
  wrong.rows = 0x10000;  // whose product is 0 in 32 bits
  wrong.values = {};
  EXPECT_NE(read_gwy(gwy::file(gwy::channel(0, "", wrong))).error, "");
  gwy::Field mask = small();
  mask.columns = 2;
  mask.rows = 3;
  EXPECT_EQ(
      read_gwy(gwy::file(gwy::channel(7, "", small()) + gwy::component("/7/mask", 'o', gwy::field(mask))))
          .error,
      "/7/mask is of another size than /7/data");
  EXPECT_TRUE(read_gwy(gwy::file("")).error.empty());
  EXPECT_TRUE(read_gwy(gwy::file("")).channels.empty());
}

TEST(GwyFile, MoreChannelsThanAnybodyHasAreRefused) {
  // Of what is kept, too, so that a file cannot ask for more memory than it has bytes.
  std::string images, titles;
  for (int i = 0; i < 1024; ++i) images += gwy::channel(i, "", small());
  EXPECT_EQ(read_gwy(gwy::file(images)).channels.size(), 1024u);
  EXPECT_EQ(read_gwy(gwy::file(images + gwy::channel(1024, "", small()))).error,
            "has more than 1024 channels");
  for (int i = 0; i < 1025; ++i)
    titles += gwy::component("/" + std::to_string(i) + "/data/title", 's', gwy::text(""));
  EXPECT_EQ(read_gwy(gwy::file(titles)).error, "has more than 1024 channels");
}

TEST(GwyFile, WordsFromFilesArePrintable) {
  EXPECT_EQ(printable("a\nb\x7f\tc"), "a?b??c");
  EXPECT_EQ(printable("\xc2\xb5m"), "\xc2\xb5m");  // µ stays
  EXPECT_EQ(printable("\xc2\x9b"
                      "31m"),
            "??31m");  // CSI does not
  // What is no UTF-8 would make a scene's file unreadable: Latin-1, a cut, an overlong '/', half a surrogate
  // pair, too far.
  EXPECT_EQ(printable("H\xf6he"), "H?he");
  EXPECT_EQ(printable("\xc2"), "?");
  EXPECT_EQ(printable("\xc0\xaf"), "??");
  EXPECT_EQ(printable("\xed\xa0\x80"), "???");
  EXPECT_EQ(printable("\xf4\x90\x80\x80"), "????");
  EXPECT_EQ(printable("\xe2\x82\xac\xf0\x9f\x94\xac"), "\xe2\x82\xac\xf0\x9f\x94\xac");
  EXPECT_EQ(printable(std::string(119, 'x') + "\xc2\xb5"), std::string(119, 'x'));  // no half of a letter
  EXPECT_EQ(printable(std::string(500, 'x')).size(), 120u);
}

}  // namespace
}  // namespace telenano::import

// The committed datagrams of proto/golden: what they mean, and that every other byte is noticed.
#include <gtest/gtest.h>

#include <array>

#include "codec_bytes.h"
#include "golden_messages.h"

namespace telenano::link {
namespace {

TEST(Golden, FilesDecodeToTheirMessages) {
  const GoldenMessages golden;
  Codec codec;
  Incoming in;
  const auto files = golden_files();
  for (std::size_t i = 0; i < files.size(); ++i) {
    ASSERT_EQ(codec.decode(files[i], in), DropCause::kNone) << kGoldenNames[i];
    EXPECT_TRUE(matches(in, golden, i)) << kGoldenNames[i];
  }
}

TEST(Golden, MessagesEncodeToWhatDecodesTheSame) {
  const GoldenMessages golden;
  Codec codec;
  Incoming in;
  const auto all = golden.encoded();
  for (std::size_t i = 0; i < all.size(); ++i) {
    ASSERT_EQ(codec.decode(all[i], in), DropCause::kNone);
    EXPECT_TRUE(matches(in, golden, i)) << kGoldenNames[i];
  }
}

TEST(Golden, OurOwnBytesAreTheFiles) {
  // More than the protocol asks of an implementation: fields that are zero are not on the wire, so that a
  // session without features is the same bytes as before there were any.
  EXPECT_EQ(GoldenMessages{}.encoded(), golden_files());
}

TEST(Golden, AMessageWithoutFeaturesClearsThoseOfTheOneBefore) {
  const GoldenMessages golden;
  Codec codec;
  Incoming in;
  const auto files = golden_files();
  for (const std::size_t which : {9u, 7u, 4u, 8u, 5u}) {
    ASSERT_EQ(codec.decode(files[which], in), DropCause::kNone);
    EXPECT_TRUE(matches(in, golden, which)) << kGoldenNames[which];
  }
  // The same through the encoder, whose messages are reused too.
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  EXPECT_EQ(codec.encode(golden.command_with_features, out), files[7].size());
  EXPECT_EQ(codec.encode(golden.command, out), files[4].size());
  EXPECT_EQ(codec.encode(golden.reply_with_features, out), files[8].size());
  EXPECT_EQ(codec.encode(golden.reply, out), files[5].size());
}

TEST(Golden, EveryTruncationAndExtensionIsDropped) {
  Codec codec;
  Incoming in;
  for (const auto& file : golden_files()) {
    for (std::size_t n = 0; n < file.size(); ++n) {
      EXPECT_EQ(codec.decode(std::span(file).first(n), in), DropCause::kTruncated);
    }
    Bytes longer = file;
    longer.push_back(0);
    EXPECT_EQ(codec.decode(longer, in), file.size() == 512 ? DropCause::kOversize : DropCause::kBadLength);
  }
}

TEST(Golden, EverySingleByteCorruptionIsDroppedOrAnotherValue) {
  const GoldenMessages golden;
  Codec codec;
  Incoming in;
  std::size_t accepted = 0;
  const auto files = golden_files();
  for (std::size_t which = 0; which < files.size(); ++which) {
    const Bytes& file = files[which];
    const auto type = static_cast<MessageType>(file[5]);
    for (std::size_t at = 0; at < file.size(); ++at) {
      for (int flip = 1; flip < 256; ++flip) {
        Bytes bytes = file;
        bytes[at] = static_cast<std::uint8_t>(bytes[at] ^ flip);
        const DropCause cause = codec.decode(bytes, in);
        if (cause != DropCause::kNone) continue;
        ++accepted;
        // Header bytes: the version of Hello and Refuse does not count, and with another type the same fields
        // may make another message (a Challenge is a Command of two fields, of a session that does not
        // exist). Elsewhere it is the value that changed, except in a Hello's padding, which is ignored.
        if (at == 5) {
          EXPECT_NE(in.type, type);
        } else if (at < 8) {
          EXPECT_TRUE(at == 4 && (type == MessageType::kHello || type == MessageType::kRefuse)) << at;
        } else if (type != MessageType::kHello) {
          EXPECT_FALSE(matches(in, golden, which)) << kGoldenNames[which] << " byte " << at;
        }
      }
    }
  }
  EXPECT_GT(accepted, 10000u);
}

}  // namespace
}  // namespace telenano::link

#include "telenano/common/link/codec.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "codec_bytes.h"
#include "golden_messages.h"
#include "proto/wire_fields.h"
#include "telenano/common/link/wire_scan.h"

namespace telenano::link {
namespace {

const Bytes kBye = {0x09, 1, 0, 0, 0, 0, 0, 0, 0, 0x15, 1, 0, 0, 0};  // session 1, reason 1

TEST(Codec, NamesTheCauseOfEachDrop) {
  EXPECT_EQ(decode({}), DropCause::kTruncated);
  EXPECT_EQ(decode(datagram(MessageType::kBye, kBye)), DropCause::kNone);
  Bytes b = datagram(MessageType::kBye, kBye);
  b[0] = 'X';
  EXPECT_EQ(decode(b), DropCause::kBadMagic);
  b = datagram(MessageType::kBye, kBye);
  b[4] = 2;
  EXPECT_EQ(decode(b), DropCause::kWrongVersion);
  EXPECT_EQ(decode(datagram(static_cast<MessageType>(15), kBye)), DropCause::kUnknownType);
  EXPECT_EQ(decode(datagram(MessageType::kNone, kBye)), DropCause::kUnknownType);
  EXPECT_EQ(decode(Bytes(513)), DropCause::kOversize);
  EXPECT_EQ(decode(datagram(MessageType::kHello, {0x0d, 1, 0, 0, 0})), DropCause::kBadLength) << "not padded";

  const auto with = [](std::initializer_list<std::uint8_t> extra) {
    Bytes payload = kBye;
    payload.insert(payload.end(), extra);
    return datagram(MessageType::kBye, payload);
  };
  EXPECT_EQ(decode(with({0x1d, 1, 0, 0, 0})), DropCause::kMalformedField) << "unknown field 3";
  EXPECT_EQ(decode(with({0x22, 1, 0})), DropCause::kMalformedField) << "unknown length-delimited field";
  EXPECT_EQ(decode(with({0x15, 1, 0, 0, 0})), DropCause::kMalformedField) << "field 2 twice";
  EXPECT_EQ(decode(with({0x00})), DropCause::kMalformedField) << "field 0";
  EXPECT_EQ(decode(with({0x80})), DropCause::kMalformedField) << "tag cut";
  EXPECT_EQ(decode(with({0x80, 0x80, 0x80, 0x01})), DropCause::kMalformedField) << "long tag";
  EXPECT_EQ(decode(with({0x0b})), DropCause::kMalformedField) << "group";
  EXPECT_EQ(decode(datagram(MessageType::kBye, {0x08, 1})), DropCause::kMalformedField)
      << "varint for fixed64";
  EXPECT_EQ(decode(datagram(MessageType::kBye, {0x09, 1, 0, 0})), DropCause::kMalformedField) << "value cut";
  EXPECT_EQ(decode(datagram(MessageType::kBye, {0x89, 0x00, 1, 0, 0, 0, 0, 0, 0, 0})),
            DropCause::kMalformedField)
      << "tag not in its shortest form";

  EXPECT_EQ(decode(datagram(MessageType::kBye, {0x09, 1, 0, 0, 0, 0, 0, 0, 0})), DropCause::kOutOfRange)
      << "no reason";
  EXPECT_EQ(decode(datagram(MessageType::kBye, {})), DropCause::kOutOfRange) << "no session";
}

TEST(Codec, RepeatedCommandsAreWholeRecordsInOrderAtTheEnd) {
  const GoldenMessages golden;
  Codec codec;
  Incoming in;
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  const auto cause_of = [&](const RecentCommands& recent, std::uint64_t sequence = 1001) {
    Command c = golden.command_with_features;
    c.sequence = sequence;
    const std::size_t n = codec.encode(c, recent, out);
    EXPECT_LE(n, kMaxDatagramBytes);
    return codec.decode(std::span(out).first(n), in);
  };
  for (std::size_t count = 0; count <= kMaxRecent; ++count) {
    RecentCommands recent = golden.recent;
    recent.count = count;
    EXPECT_EQ(cause_of(recent), DropCause::kNone) << count;
    EXPECT_TRUE(same(in.recent, recent)) << count;
  }
  EXPECT_EQ(cause_of(golden.recent, 5), DropCause::kNone);
  EXPECT_EQ(cause_of(golden.recent, 4), DropCause::kOutOfRange) << "a command before the first";
  RecentCommands bad = golden.recent;
  bad.record[2].age_ns = bad.record[1].age_ns - 1;
  EXPECT_EQ(cause_of(bad), DropCause::kOutOfRange) << "an older one that is younger";
  bad = golden.recent;
  bad.record[3].energy = -1;
  EXPECT_EQ(cause_of(bad), DropCause::kOutOfRange);
  for (int k = 0; k < 7; ++k) {
    bad = golden.recent;
    RecentCommand& r = bad.record[3];
    double* const fields[] = {&r.tip_pos_w_nm.x(), &r.tip_pos_w_nm.y(), &r.tip_pos_w_nm.z(), &r.energy,
                              &r.wave_sum.x(),     &r.wave_sum.y(),     &r.wave_sum.z()};
    *fields[k] = std::numeric_limits<double>::quiet_NaN();
    EXPECT_EQ(cause_of(bad), DropCause::kNonFinite) << k;
  }

  const std::size_t plain = codec.encode(golden.command, out);
  const Bytes command(out.begin() + kHeaderBytes, out.begin() + static_cast<std::ptrdiff_t>(plain));
  const auto with = [&](const Bytes& tail, bool in_front = false) {
    Bytes payload = in_front ? tail : command;
    const Bytes& rest = in_front ? command : tail;
    payload.insert(payload.end(), rest.begin(), rest.end());
    return decode(datagram(MessageType::kCommand, payload));
  };
  const auto records = [](std::size_t bytes) {
    Bytes tail = {0xc2, 0x02};
    if (bytes >= 0x80) tail.push_back(static_cast<std::uint8_t>((bytes & 0x7f) | 0x80));
    tail.push_back(static_cast<std::uint8_t>(bytes >= 0x80 ? bytes >> 7 : bytes));
    tail.insert(tail.end(), bytes, 0);
    return tail;
  };
  EXPECT_EQ(with(records(64)), DropCause::kNone);
  EXPECT_EQ(with(records(256)), DropCause::kNone);
  EXPECT_EQ(with(records(0)), DropCause::kMalformedField) << "none are not sent";
  EXPECT_EQ(with(records(63)), DropCause::kMalformedField) << "half a record";
  EXPECT_EQ(with(records(320)), DropCause::kMalformedField) << "five";
  EXPECT_EQ(with(records(64), true), DropCause::kMalformedField) << "not the last field";
  Bytes twice = records(64);
  const Bytes again = twice;
  twice.insert(twice.end(), again.begin(), again.end());
  EXPECT_EQ(with(twice), DropCause::kMalformedField);
  Bytes cut = records(64);
  cut.pop_back();
  EXPECT_EQ(with(cut), DropCause::kMalformedField);
  // Fields in another order before them take the slow way through the scan; the same must come out.
  Bytes turned(command.begin() + 9, command.end());
  turned.insert(turned.end(), command.begin(), command.begin() + 9);
  const std::size_t n = codec.encode(golden.command, golden.recent, out);
  turned.insert(turned.end(), out.begin() + static_cast<std::ptrdiff_t>(plain),
                out.begin() + static_cast<std::ptrdiff_t>(n));
  ASSERT_EQ(codec.decode(datagram(MessageType::kCommand, turned), in), DropCause::kNone);
  EXPECT_TRUE(same(in.command, golden.command) && same(in.recent, golden.recent));
}

TEST(Codec, RefusesALongSceneName) {
  const Bytes golden = golden_files()[2];
  const std::string name = "flakes";
  const auto found = std::search(golden.begin(), golden.end(), name.begin(), name.end());
  ASSERT_NE(found, golden.end());
  const std::ptrdiff_t at = found - golden.begin();
  Bytes file = golden;
  file.insert(file.begin() + at, 43, 'x');  // 49 bytes, and so says the length before them
  file[static_cast<std::size_t>(at) - 1] = 49;
  const std::size_t payload = file.size() - kHeaderBytes;
  file[6] = static_cast<std::uint8_t>(payload & 0xff);
  file[7] = static_cast<std::uint8_t>(payload >> 8);
  EXPECT_EQ(decode(file), DropCause::kMalformedField);
}

TEST(Codec, FieldsBeyondTheLastAreUnknownWhateverTheirTag) {
  // Two-byte tags up to 511 and beyond: only those of the list, in their shortest form.
  const auto files = golden_files();
  for (const std::size_t which : {7u, 8u}) {
    const FieldList& fields = which == 7 ? kCommandFields : kReplyFields;
    const auto known = [&](std::uint32_t number) {
      return number <= kMaxFields && (fields[number] == kFixed32 || fields[number] == kFixed64);
    };
    for (std::uint32_t number = 16; number < 300; ++number) {
      if (known(number)) continue;
      for (const std::uint32_t wire_type : {1u, 5u}) {
        Bytes payload(files[which].begin() + kHeaderBytes, files[which].end());
        const std::uint32_t tag = number << 3 | wire_type;
        payload.push_back(static_cast<std::uint8_t>((tag & 0x7f) | 0x80));
        payload.push_back(static_cast<std::uint8_t>(tag >> 7));
        payload.insert(payload.end(), wire_type == 1 ? 8 : 4, 0);
        EXPECT_EQ(decode(datagram(kGoldenTypes[which], payload)), DropCause::kMalformedField) << number;
      }
    }
  }
}

/// The fields of a datagram without byte strings, each with its tag.
std::vector<Bytes> fields_of(const Bytes& file) {
  std::vector<Bytes> fields;
  for (std::size_t at = kHeaderBytes; at < file.size();) {
    const std::size_t size = (file[at] >= 0x80 ? 2u : 1u) + ((file[at] & 7) == 1 ? 8u : 4u);
    fields.emplace_back(file.begin() + static_cast<std::ptrdiff_t>(at),
                        file.begin() + static_cast<std::ptrdiff_t>(at + size));
    at += size;
  }
  return fields;
}

TEST(Codec, EveryFieldTwiceIsMalformed) {
  const auto files = golden_files();
  for (const std::size_t which : {4u, 5u, 7u, 8u}) {
    for (const Bytes& field : fields_of(files[which])) {
      Bytes payload(files[which].begin() + kHeaderBytes, files[which].end());
      payload.insert(payload.end(), field.begin(), field.end());
      EXPECT_EQ(decode(datagram(kGoldenTypes[which], payload)), DropCause::kMalformedField)
          << kGoldenNames[which] << " tag " << int{field[0]};
    }
  }
}

TEST(Codec, ReadsTheFieldsBackwards) {
  // Out of order, so that the scan by table sees them all: also numbers of 32 and above, beside every lower
  // one.
  const GoldenMessages golden;
  const auto files = golden_files();
  Codec codec;
  Incoming in;
  for (const std::size_t which : {4u, 5u, 7u, 8u}) {
    const auto fields = fields_of(files[which]);
    Bytes payload;
    for (auto field = fields.rbegin(); field != fields.rend(); ++field)
      payload.insert(payload.end(), field->begin(), field->end());
    ASSERT_EQ(codec.decode(datagram(kGoldenTypes[which], payload), in), DropCause::kNone)
        << kGoldenNames[which];
    EXPECT_TRUE(matches(in, golden, which)) << kGoldenNames[which];
  }
}

TEST(Scan, TakesNoTagInALongerForm) {
  // 0x89 0x00 is field 1, fixed64, in two bytes; seven more make up the length of the shortest form. Protobuf
  // would see a field cut short; the scan has to see it first.
  WireFrame frame;
  EXPECT_EQ(scan(datagram(MessageType::kBye, {0x89, 0x00, 1, 0, 0, 0, 0, 0, 0}), frame),
            DropCause::kMalformedField);
  EXPECT_EQ(scan(datagram(MessageType::kBye, {0x09, 1, 0, 0, 0, 0, 0, 0, 0}), frame), DropCause::kNone);
}

TEST(Codec, WritesNothingIntoTooSmallABuffer) {
  const GoldenMessages golden;
  Codec codec;
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  const auto all = golden.encoded();
  const auto try_all = [&](const auto& message, std::size_t size) {
    out.fill(0xee);
    EXPECT_EQ(codec.encode(message, std::span(out).first(size - 1)), 0u);
    EXPECT_EQ(out[size - 1], 0xee);
    EXPECT_EQ(codec.encode(message, std::span(out).first(size)), size);
  };
  try_all(golden.hello, all[0].size());
  try_all(golden.challenge, all[1].size());
  try_all(golden.welcome, all[2].size());
  try_all(golden.refuse, all[3].size());
  try_all(golden.command, all[4].size());
  try_all(golden.reply, all[5].size());
  try_all(golden.bye, all[6].size());
  try_all(golden.command_with_features, all[7].size());
  try_all(golden.reply_with_features, all[8].size());
}

/// Every field 1.
struct Full {
  template <std::uint32_t kNumber, class Value>
  void operator()(Value& value) noexcept {
    value = Value(1);
  }
  template <class Body>
  void run(const Body& body) noexcept {
    body(*this);
  }
};

// Steps and a deadband for replies are in no session together: with every other field they would be longer than a
// datagram. Nothing is written then, whatever room there is; without the one or the other all fit.
TEST(Codec, StepsAndADeadbandTogetherAreNoLongerThanADatagram) {
  Full full;
  Command c;
  visit_fields(c, full);
  visit_feature_fields(c, full);
  ASSERT_EQ(c.reply_deadband, (ReplyDeadband{1, 1}));
  const Bytes steps(kStepsBytesMost, 7);
  Codec codec;
  Bytes out(kMaxDatagramBytes + 200, 0xA5);
  for (const std::size_t room : {kMaxDatagramBytes, out.size()}) {
    EXPECT_EQ(codec.encode(c, steps, std::span(out).first(room)), 0u) << room;
    EXPECT_EQ(std::count(out.begin(), out.end(), 0xA5), static_cast<std::ptrdiff_t>(out.size()))
        << "untouched";
  }
  EXPECT_EQ(codec.encode(c, out), 219u);
  c.reply_deadband = {};
  EXPECT_EQ(codec.encode(c, steps, out), 511u);
  std::fill(out.begin(), out.end(), 0xA5);
  EXPECT_EQ(codec.encode(c, steps, std::span(out).first(kMaxDatagramBytes)), 511u);
  EXPECT_EQ(out[511], 0xA5);
}

TEST(Codec, KeepsEveryBitOfADouble) {
  Codec codec;
  Incoming in;
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  Command c = GoldenMessages{}.command;
  c.tip_pos_w_nm = {-0.0, std::numeric_limits<double>::denorm_min(), 0.1};
  const std::size_t n = codec.encode(c, out);
  ASSERT_EQ(codec.decode(std::span(out).first(n), in), DropCause::kNone);
  EXPECT_TRUE(std::signbit(in.command.tip_pos_w_nm.x()));
  EXPECT_EQ(in.command.tip_pos_w_nm.y(), std::numeric_limits<double>::denorm_min());
  EXPECT_EQ(in.command.tip_pos_w_nm.z(), 0.1);
}

TEST(Codec, AHelloOfAnyContentFillsTheLargestDatagram) {
  Codec codec;
  Incoming in;
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  Hello hello;
  hello.nonce = 1;
  for (const bool full : {false, true}) {
    if (full) hello = GoldenMessages{}.hello;
    ASSERT_EQ(codec.encode(hello, out), kMaxDatagramBytes);
    ASSERT_EQ(codec.decode(out, in), DropCause::kNone);
    EXPECT_TRUE(same(in.hello, hello));
  }
}

TEST(Codec, NoAnswerToAHelloIsLargerThanIt) {
  Codec codec;
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  GoldenMessages largest;
  largest.welcome.scene_name.text.fill('x');
  EXPECT_LE(codec.encode(largest.challenge, out), kMaxDatagramBytes);
  EXPECT_LE(codec.encode(largest.refuse, out), kMaxDatagramBytes);
  EXPECT_LE(codec.encode(largest.welcome, out), 300u) << "as PROTOCOL.md says";
  // Nor is any reply: every field set but those of sharing.
  EXPECT_EQ(codec.encode(largest.command_with_features, out), 201u);
  EXPECT_EQ(codec.encode(largest.reply_with_features, out), 327u);
  EXPECT_EQ(codec.encode(largest.reply_with_history, out), 337u);
  Reply every = largest.reply_with_history;
  every.tip = largest.reply_with_sharing.tip;
  every.particle = largest.reply_with_particle.particle;
  EXPECT_EQ(codec.encode(every, out), 419u);
}

TEST(DropCauses, HaveNamesOfTheirOwn) {
  for (std::size_t i = 0; i < kDropCauseCount; ++i) {
    for (std::size_t j = i + 1; j < kDropCauseCount; ++j) {
      EXPECT_STRNE(name(static_cast<DropCause>(i)), name(static_cast<DropCause>(j)));
    }
  }
  EXPECT_STREQ(name(DropCause::kRateLimited), "rate_limited");
  DropCounters counters;
  counters.add(DropCause::kStale);
  counters.add(DropCause::kStale);
  EXPECT_EQ(counters[DropCause::kStale], 2u);
  EXPECT_EQ(counters.total(), 2u);
}

}  // namespace
}  // namespace telenano::link

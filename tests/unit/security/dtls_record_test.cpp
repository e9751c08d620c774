// What a datagram is taken for before OpenSSL sees it. The layouts are those of RFC 6347, section 4.1
// and 4.2.2.
#include "telenano/common/security/dtls_record.h"

#include <gtest/gtest.h>

#include <vector>

namespace telenano::security {
namespace {

std::vector<std::uint8_t> record(std::uint8_t type, std::uint8_t epoch, std::size_t length,
                                 std::uint8_t first = 0) {
  std::vector<std::uint8_t> bytes(kRecordHeaderBytes + length);
  const std::uint8_t head[] = {type,
                               0xfe,
                               0xfd,
                               0,
                               epoch,
                               0,
                               0,
                               0,
                               0,
                               0,
                               1,
                               static_cast<std::uint8_t>(length >> 8),
                               static_cast<std::uint8_t>(length)};
  std::copy(std::begin(head), std::end(head), bytes.begin());
  if (length > 0) bytes[kRecordHeaderBytes] = first;
  return bytes;
}

std::vector<std::uint8_t> operator+(std::vector<std::uint8_t> a, const std::vector<std::uint8_t>& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

TEST(DtlsRecord, KindsByTypeAndEpoch) {
  EXPECT_EQ(kind_of(record(22, 0, 60, 1)), RecordKind::kClientHello);
  EXPECT_EQ(kind_of(record(22, 0, 60, 2)), RecordKind::kHandshake);
  EXPECT_EQ(kind_of(record(22, 1, 60, 1)), RecordKind::kHandshake);  // sealed: its first byte says nothing
  EXPECT_EQ(kind_of(record(20, 0, 1)), RecordKind::kHandshake);
  EXPECT_EQ(kind_of(record(21, 0, 2)), RecordKind::kAlert);
  EXPECT_EQ(kind_of(record(21, 1, 26)), RecordKind::kAlert);
  EXPECT_EQ(kind_of(record(23, 1, 60)), RecordKind::kData);
  EXPECT_EQ(kind_of(record(23, 0, 60)), RecordKind::kNotDtls);  // data in the clear
  for (const std::uint8_t type : std::initializer_list<std::uint8_t>{0, 19, 24, 25, 84, 255})
    EXPECT_EQ(kind_of(record(type, 1, 60)), RecordKind::kNotDtls);
  EXPECT_EQ(kind_of({}), RecordKind::kNotDtls);
}

TEST(DtlsRecord, OnlyWholeRecordsAndSealsInFull) {
  for (std::size_t length = 0; length < 40; ++length) {
    EXPECT_EQ(kind_of(record(23, 1, length)) == RecordKind::kData, length >= 16) << length;
    EXPECT_EQ(kind_of(record(22, 1, length)) == RecordKind::kHandshake, length >= 16) << length;
    EXPECT_EQ(well_formed(record(23, 1, length), kAesGcmSealBytes), length >= 24) << length;
    EXPECT_EQ(kind_of(record(20, 0, length)) == RecordKind::kHandshake, length >= 1) << length;
  }
  auto high_epoch = record(23, 0, 12);
  high_epoch[3] = 1;
  EXPECT_EQ(kind_of(high_epoch), RecordKind::kNotDtls);
  const auto good = record(22, 0, 60, 1);
  for (std::size_t size = 0; size < good.size(); ++size)
    EXPECT_EQ(kind_of(std::span(good).first(size)), RecordKind::kNotDtls) << size;
  EXPECT_EQ(kind_of(good + std::vector<std::uint8_t>{0}), RecordKind::kNotDtls);
  // A flight: several records. One bad spoils all.
  EXPECT_EQ(kind_of(record(22, 0, 60, 16) + record(20, 0, 1) + record(22, 1, 40)), RecordKind::kHandshake);
  EXPECT_EQ(kind_of(record(22, 0, 60, 16) + record(20, 0, 1) + record(22, 1, 15)), RecordKind::kNotDtls);
  for (const std::uint8_t version : std::initializer_list<std::uint8_t>{0x00, 0xfc, 0xfe}) {
    auto other = good;
    other[2] = version;
    EXPECT_EQ(kind_of(other), RecordKind::kNotDtls) << int{version};
  }
}

TEST(DtlsRecord, TheNumberIsEpochAndSequence) {
  auto bytes = record(23, 1, 30);
  EXPECT_EQ(record_number(bytes), (std::uint64_t{1} << 48) + 1);
  bytes[5] = 0xab;
  EXPECT_EQ(record_number(bytes), (std::uint64_t{1} << 48) + (std::uint64_t{0xab} << 40) + 1);
}

TEST(DtlsRecord, AClientHellosRandomAndCookie) {
  auto hello = record(22, 0, 12 + 2 + 32 + 1 + 4 + 1 + 8, 1);
  for (std::uint8_t i = 0; i < 32; ++i)
    hello[kRecordHeaderBytes + 14 + i] = static_cast<std::uint8_t>(100 + i);
  const std::size_t session_id = kRecordHeaderBytes + 12 + 2 + 32;
  hello[session_id] = 4;
  ClientHelloView view;
  ASSERT_TRUE(parse_client_hello(hello, view));
  EXPECT_EQ(view.random[0], 100);
  EXPECT_EQ(view.random[31], 131);
  EXPECT_FALSE(view.has_cookie);
  hello[session_id + 5] = 8;
  ASSERT_TRUE(parse_client_hello(hello, view));
  EXPECT_TRUE(view.has_cookie);
  // A session id that leads outside, and every cut.
  for (std::size_t size = 0; size <= session_id + 5; ++size)
    EXPECT_FALSE(parse_client_hello(std::span(hello).first(size), view)) << size;
  hello[session_id] = 255;
  EXPECT_FALSE(parse_client_hello(hello, view));
}

}  // namespace
}  // namespace telenano::security

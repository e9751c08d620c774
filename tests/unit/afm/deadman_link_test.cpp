// Heartbeats to the deadman. The frames of the other end are Python's, made with its own hmac module.
#include "telenano/nve_server/afm/deadman_link.h"

#include <gtest/gtest.h>

#include <string>

#include "telenano/common/hash/sha256.h"
#include "telenano/nve_server/nanonis/frame_reader.h"

namespace telenano::afm {
namespace {

std::string hex(std::span<const std::uint8_t> bytes) {
  std::string text;
  for (const std::uint8_t byte : bytes) {
    text += "0123456789abcdef"[byte >> 4];
    text += "0123456789abcdef"[byte & 15];
  }
  return text;
}

nanonis::Bytes bytes_of(const std::string& text) {
  nanonis::Bytes bytes;
  for (std::size_t i = 0; i + 1 < text.size(); i += 2)
    bytes.push_back(static_cast<std::uint8_t>(std::stoi(text.substr(i, 2), nullptr, 16)));
  return bytes;
}

DeadmanKey counting_key() {
  DeadmanKey key;
  for (std::size_t i = 0; i < key.size(); ++i) key[i] = static_cast<std::uint8_t>(i);
  return key;
}

struct Link {
  Link() : link(counting_key(), nonce()) {}
  static std::array<std::uint8_t, 16> nonce() {
    std::array<std::uint8_t, 16> n;
    n.fill(0xbb);
    return n;
  }
  void feed(const std::string& name, const std::string& body_hex) {
    nanonis::Header header;
    header.name = name;
    link.feed(header, bytes_of(body_hex));
  }
  void greet() { feed("Telenano.Deadman", "000101f4" + std::string(32, 'a')); }
  DeadmanLink link;
};

// python3 -c 'import hmac; print(hmac.new(bytes(range(32)), b"Telenano beat 1" + b"\xaa"*16 + b"\xbb"*16 +
// (1).to_bytes(8,"big") + (1).to_bytes(2,"big"), "sha256").hexdigest())', and so on.
const std::string kBeatProof = "328fbe899481fec3da4a1ac994f4fca7f5f2cb18499fb577204b60611ac6c187";
const std::string kAnswerProof = "9a8e889d8a5f91e408381ea8ce25242b5e4d115fd63af28ccbe3ceee829fc57a";
const std::string kFirst = "0000000000000001";

TEST(DeadmanLink, TheHmacIsTheStandards) {
  // RFC 4231's keys have other sizes; of 32 bytes, by Python's hmac.
  EXPECT_EQ(hex(hmac_sha256(counting_key(), "what do ya want for nothing?")),
            "099805f4ac310786968565c098db515cc50862b420ae31e20238312344bed36a");
}

TEST(DeadmanLink, ABeatIsWhatTheDeadmanExpects) {
  Link l;
  EXPECT_FALSE(l.link.greeted());
  l.greet();
  ASSERT_TRUE(l.link.greeted());
  EXPECT_EQ(l.link.silence_ms(), 500);
  const nanonis::Bytes frame = l.link.beat(DeadmanBeat::kWatch);
  nanonis::FrameReader reader;
  reader.feed(frame);
  nanonis::Header header;
  std::span<const std::uint8_t> body;
  ASSERT_EQ(reader.next(header, body), nanonis::FrameReader::Status::kFrame);
  EXPECT_EQ(header.name, "Telenano.Beat");
  EXPECT_EQ(hex(body), std::string(32, 'b') + kFirst + "0001" + kBeatProof);
}

TEST(DeadmanLink, OnlyAProvedAnswerToTheLastBeatCounts) {
  const std::string good = kFirst + "0001" + kAnswerProof;
  {
    Link l;
    l.greet();
    l.link.beat(DeadmanBeat::kWatch);
    EXPECT_TRUE(l.link.waiting());
    l.feed("Telenano.Beat", good);
    EXPECT_FALSE(l.link.broken());
    EXPECT_EQ(l.link.answers(), 1u);
    EXPECT_FALSE(l.link.waiting());
    EXPECT_EQ(l.link.state(), DeadmanState::kLatched);
    EXPECT_EQ(l.link.answered_beat(), DeadmanBeat::kWatch);
    l.feed("Telenano.Beat", "0000000000000002" + good.substr(16));  // to nothing that was sent
    EXPECT_TRUE(l.link.broken());
  }
  // Any bit changed, or none of it there, or the answer to another greeting.
  for (std::size_t i = 0; i < good.size(); i += 7) {
    Link l;
    l.greet();
    l.link.beat(DeadmanBeat::kWatch);
    std::string forged = good;
    forged[i] = forged[i] == '1' ? '0' : '1';
    l.feed("Telenano.Beat", forged);
    EXPECT_TRUE(l.link.broken()) << i;
    EXPECT_EQ(l.link.answers(), 0u);
  }
  for (const std::string& wrong : {std::string(), good.substr(2), good + "00"}) {
    Link l;
    l.greet();
    l.link.beat(DeadmanBeat::kWatch);
    l.feed("Telenano.Beat", wrong);
    EXPECT_TRUE(l.link.broken());
  }
  Link other;
  other.feed("Telenano.Deadman", "000101f4" + std::string(32, 'c'));
  other.link.beat(DeadmanBeat::kWatch);
  other.feed("Telenano.Beat", good);
  EXPECT_TRUE(other.link.broken()) << "recorded on another connection";
}

TEST(DeadmanLink, ANewConnectionBeginsAnew) {
  Link l;
  l.greet();
  l.link.beat(DeadmanBeat::kWatch);
  l.link.restart();
  EXPECT_FALSE(l.link.greeted());
  EXPECT_FALSE(l.link.waiting());
  l.feed("Telenano.Deadman", "000201f4" + std::string(32, 'a'));
  EXPECT_TRUE(l.link.broken()) << "another version";
}

TEST(DeadmanLink, AKeyIs64Digits) {
  const std::string text = "000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1D1E1F";
  EXPECT_EQ(parse_deadman_key(text), counting_key());
  EXPECT_EQ(parse_deadman_key(text + "\r\n"), counting_key());
  for (const std::string& wrong : {std::string(), text.substr(1), text + "0", std::string(64, 'g')})
    EXPECT_FALSE(parse_deadman_key(wrong)) << wrong;
}

}  // namespace
}  // namespace telenano::afm

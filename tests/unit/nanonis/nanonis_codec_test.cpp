// Golden bytes: made by the second encoder in Python from the protocol's published tables, not by this code.
#include "telenano/nve_server/nanonis/codec.h"

#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <string>

#include "telenano/nve_server/nanonis/frame_reader.h"
#include "tests/source_dir.h"

namespace telenano::nanonis {
namespace {

Bytes from_hex(const std::string& hex) {
  Bytes bytes;
  for (std::size_t i = 0; i + 1 < hex.size(); i += 2)
    bytes.push_back(static_cast<std::uint8_t>(std::stoi(hex.substr(i, 2), nullptr, 16)));
  return bytes;
}

std::map<std::string, Bytes> golden(const Command& c) {
  const std::string path =
      std::string(TELENANO_SOURCE_DIR) + "/tests/unit/nanonis/golden/" + std::string(c.name) + ".hex";
  std::ifstream file(path);
  std::map<std::string, Bytes> all;
  for (std::string kind, hex; file >> kind >> hex;) all[kind] = from_hex(hex);
  EXPECT_EQ(all.size(), 4u) << path;
  return all;
}

struct Example {
  std::vector<double> arguments;
  std::vector<double> values;
  std::vector<std::string> texts{};
};

double f(double value) {
  return static_cast<float>(value);
}

/// The values of the golden files, as they read after a float's rounding.
const std::map<CommandId, Example>& examples() {
  using enum CommandId;
  static const std::map<CommandId, Example> kExamples = {
      {kXyPosSet, {{10e-9, 15e-9, 1}, {}}},
      {kXyPosGet, {{1}, {-2.5e-7, 1.25e-9}}},
      {kSpeedSet, {{f(1e-6), 1}, {}}},
      {kSpeedGet, {{}, {f(2.5e-7), 0}}},
      {kStop, {{}, {}}},
      {kOnOffSet, {{1}, {}}},
      {kOnOffGet, {{}, {1}}},
      {kZPosSet, {{f(-3.5e-8)}, {}}},
      {kZPosGet, {{}, {f(4.75e-8)}}},
      {kStatusGet, {{}, {5}}},
      {kSetpointSet, {{f(2e-9)}, {}}},
      {kSetpointGet, {{}, {f(1.875e-9)}}},
      {kWithdraw, {{1, -1}, {}}},
      {kWithdrawRateSet, {{f(5e-6)}, {}}},
      {kTipLiftSet, {{f(2e-8)}, {}}},
      {kSwitchOffDelaySet, {{f(0.05)}, {}}},
      {kLimitsEnabledSet, {{1}, {}}},
      {kLimitsSet, {{f(5e-7), f(-5e-7)}, {}}},
      {kSafeTipOnOffSet, {{2}, {}}},
      {kSafeTipOnOffGet, {{}, {1}}},
      {kSafeTipPropsSet, {{0, 1, f(1.5e-8)}, {}}},
      {kSafeTipPropsGet, {{}, {0, 1, f(1.5e-8)}}},
      {kSignalNamesGet, {{}, {}, {"Current (A)", "Deflection (m)", ""}}},
      {kSignalValGet, {{24, 1}, {f(-1.5e-9)}}},
      {kSignalValsGet, {{8, 9, 0}, {f(2e-9), -0.125}}},
      {kSignalCalibrGet, {{8}, {f(5e-8), f(1e-9)}}},
      {kPiezoRangeGet, {{}, {f(1e-5), f(1e-5), f(2e-6)}}},
      {kAcqPeriodSet, {{f(0.005)}, {}}},
      {kAcqPeriodGet, {{}, {f(0.02)}}},
      {kWithdrawRateGet, {{}, {f(5e-6)}}},
      {kTipLiftGet, {{}, {f(2e-8)}}},
      {kSwitchOffDelayGet, {{}, {f(0.05)}}},
      {kLimitsEnabledGet, {{}, {1}}},
      {kLimitsGet, {{}, {f(5e-7), f(-2.5e-7)}}},
      {kSafeTipSignalGet, {{}, {f(-1.5e-9)}}},
  };
  return kExamples;
}

std::span<const std::uint8_t> body_of(const Bytes& frame) {
  return std::span<const std::uint8_t>(frame).subspan(kHeaderBytes);
}

TEST(NanonisCodec, TheWorkedExampleOfTheDocument) {
  const Bytes bytes = encode_call({CommandId::kXyPosSet, {10e-9, 15e-9, 1}});
  Bytes expected = from_hex("466f6c4d652e5859506f73536574");
  expected.resize(32, 0);
  for (const char* hex : {"00000014", "0001", "0000", "3e45798ee2308c3a", "3e501b2b29a4692b", "00000001"}) {
    const Bytes part = from_hex(hex);
    expected.insert(expected.end(), part.begin(), part.end());
  }
  EXPECT_EQ(bytes, expected);
}

TEST(NanonisCodec, EveryCommandAgainstGoldenBytes) {
  ASSERT_EQ(examples().size(), kCommandCount);
  for (const Command& c : commands()) {
    SCOPED_TRACE(std::string(c.name));
    auto files = golden(c);
    const Example& example = examples().at(c.id);
    EXPECT_EQ(encode_call({c.id, example.arguments}), files["request"]);
    const Answer answer{example.values, example.texts, 0, ""};
    EXPECT_EQ(encode_answer(c, answer), files["reply"]);
    EXPECT_EQ(encode_answer(c, {{}, {}, 7, "no tip"}, ErrorForm::kZeroFilled), files["error-zero-filled"]);
    EXPECT_EQ(encode_answer(c, {{}, {}, 7, "no tip"}, ErrorForm::kAlone), files["error-alone"]);

    Header header;
    ASSERT_TRUE(parse_header(std::span(files["request"]).first<kHeaderBytes>(), header));
    EXPECT_EQ(header.name, c.name);
    EXPECT_TRUE(header.wants_reply);
    EXPECT_EQ(find_command(header.name), &command(c.id));
    Call call;
    ASSERT_TRUE(decode_call(c, body_of(files["request"]), call));
    EXPECT_EQ(call.numbers, example.arguments);
    Answer read;
    ASSERT_TRUE(decode_answer(c, body_of(files["reply"]), read));
    EXPECT_EQ(read.numbers, example.values);
    EXPECT_EQ(read.texts, example.texts);
    EXPECT_EQ(read.error, 0u);
    for (const char* form : {"error-zero-filled", "error-alone"}) {
      ASSERT_TRUE(decode_answer(c, body_of(files[form]), read)) << form;
      EXPECT_EQ(read.error, 7u) << form;
      EXPECT_EQ(read.error_text, "no tip") << form;
    }
  }
}

TEST(NanonisCodec, ABodyOfAnotherLengthIsRefused) {
  for (const Command& c : commands()) {
    SCOPED_TRACE(std::string(c.name));
    for (auto& [kind, bytes] : golden(c)) {
      const bool request = kind == "request";
      Call call;
      Answer answer;
      for (std::size_t n = kHeaderBytes; n < bytes.size(); ++n) {
        const auto body = std::span<const std::uint8_t>(bytes).subspan(kHeaderBytes, n - kHeaderBytes);
        // Eight bytes left of a reply can be an error without a description: that is no value either.
        const bool taken = request ? decode_call(c, body, call) : decode_answer(c, body, answer);
        EXPECT_TRUE(!taken || (!request && answer.error != 0)) << kind << n;
      }
      Bytes longer = bytes;
      longer.push_back(0);
      EXPECT_FALSE(request ? decode_call(c, body_of(longer), call)
                           : decode_answer(c, body_of(longer), answer));
    }
  }
}

TEST(NanonisCodec, WhatIsNoNumberIsRefused) {
  const Bytes nan = from_hex("7fc000000000000000000000");
  Answer answer;
  EXPECT_FALSE(decode_answer(command(CommandId::kZPosGet), nan, answer));
  Call call;
  EXPECT_FALSE(decode_call(command(CommandId::kZPosSet), std::span(nan).first(4), call));
}

TEST(NanonisCodec, HeadersThatAreNone) {
  const Bytes good = encode_call({CommandId::kStop, {}});
  Header header;
  const auto parses = [&](std::size_t at, std::uint8_t value) {
    Bytes bytes = good;
    bytes[at] = value;
    return parse_header(std::span(bytes).first<kHeaderBytes>(), header);
  };
  EXPECT_TRUE(parses(0, 'f'));
  EXPECT_FALSE(parses(0, 0)) << "no name";
  EXPECT_FALSE(parses(3, 0x80)) << "not printable";
  EXPECT_FALSE(parses(31, 'x')) << "after its end";
  EXPECT_FALSE(parses(32, 0x80)) << "negative size";
  EXPECT_FALSE(parses(33, 0x7f)) << "oversize";
  EXPECT_FALSE(parses(37, 2)) << "neither 0 nor 1";
  EXPECT_FALSE(parses(39, 1)) << "not zero";
}

TEST(FrameReader, FramesComeOutHoweverTheBytesCome) {
  Bytes stream;
  for (const Command& c : commands()) {
    const Bytes bytes = golden(c)["reply"];
    stream.insert(stream.end(), bytes.begin(), bytes.end());
  }
  for (const std::size_t piece : {std::size_t{1}, std::size_t{7}, std::size_t{39}, stream.size()}) {
    FrameReader reader;
    std::size_t seen = 0;
    for (std::size_t at = 0; at < stream.size(); at += piece) {
      reader.feed(std::span<const std::uint8_t>(stream).subspan(at, std::min(piece, stream.size() - at)));
      Header header;
      std::span<const std::uint8_t> body;
      while (reader.next(header, body) == FrameReader::Status::kFrame) {
        ASSERT_LT(seen, kCommandCount);
        EXPECT_EQ(header.name, commands()[seen].name);
        Answer answer;
        EXPECT_TRUE(decode_answer(commands()[seen], body, answer));
        ++seen;
      }
    }
    EXPECT_EQ(seen, kCommandCount);
    EXPECT_EQ(reader.waiting(), 0u);
  }
}

TEST(FrameReader, AStreamThatIsLostStaysLost) {
  FrameReader reader;
  reader.feed(Bytes(kHeaderBytes, 0xff));
  Header header;
  std::span<const std::uint8_t> body;
  EXPECT_EQ(reader.next(header, body), FrameReader::Status::kBroken);
  reader.feed(encode_call({CommandId::kStop, {}}));
  EXPECT_EQ(reader.next(header, body), FrameReader::Status::kBroken);
  reader.clear();
  reader.feed(encode_call({CommandId::kStop, {}}));
  EXPECT_EQ(reader.next(header, body), FrameReader::Status::kFrame);
}

}  // namespace
}  // namespace telenano::nanonis

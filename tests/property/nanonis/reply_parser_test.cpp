// A controller, or whoever sits on its port, may send anything: nothing but a well-formed reply is taken for
// one, and what is taken can be written again as the same bytes.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "telenano/common/base/random.h"
#include "telenano/nve_server/nanonis/frame_reader.h"

namespace telenano::nanonis {
namespace {

Answer random_answer(const Command& c, Random& random) {
  Answer answer;
  for (const char letter : c.returns) {
    if (letter == 'S') {
      answer.texts.resize(random.below(20));
      for (std::string& s : answer.texts)
        s.assign(random.below(30), static_cast<char>('a' + random.below(26)));
    } else if (letter == 'F') {
      for (std::uint64_t n = random.below(12); n > 0; --n)
        answer.numbers.push_back(static_cast<float>(random.normal()));
    } else if (letter == 'd') {
      answer.numbers.push_back(1e-7 * random.normal());
    } else if (letter == 'f') {
      answer.numbers.push_back(static_cast<float>(1e-7 * random.normal()));
    } else {
      answer.numbers.push_back(static_cast<double>(random.below(7)));
    }
  }
  return answer;
}

TEST(ReplyParser, WhatWasSaidIsHeard) {
  Random random(1);
  for (int i = 0; i < 20000; ++i) {
    const Command& c = commands()[random.below(kCommandCount)];
    const Answer said = random_answer(c, random);
    const Bytes bytes = encode_answer(c, said);
    Answer heard;
    ASSERT_TRUE(decode_answer(c, std::span(bytes).subspan(kHeaderBytes), heard)) << c.name;
    ASSERT_EQ(heard.numbers, said.numbers);
    ASSERT_EQ(heard.texts, said.texts);
  }
}

TEST(ReplyParser, MutatedRepliesAreRefusedOrMeanWhatTheySay) {
  Random random(2);
  std::size_t taken = 0, refused = 0;
  for (int i = 0; i < 200000; ++i) {
    const Command& c = commands()[random.below(kCommandCount)];
    Bytes bytes = encode_answer(c, random_answer(c, random));
    switch (random.below(4)) {
      case 0:
        bytes.resize(random.below(bytes.size() + 1));
        break;
      case 1:
        for (std::uint64_t n = 1 + random.below(4); n > 0; --n)
          bytes[random.below(bytes.size())] = static_cast<std::uint8_t>(random.bits());
        break;
      case 2:
        bytes.insert(bytes.begin() + static_cast<std::ptrdiff_t>(random.below(bytes.size() + 1)),
                     static_cast<std::uint8_t>(random.bits()));
        break;
      default:
        for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random.bits());
    }
    FrameReader reader;
    reader.feed(bytes);
    Header header;
    std::span<const std::uint8_t> body;
    const auto status = reader.next(header, body);
    if (status != FrameReader::Status::kFrame) {
      ++refused;
      continue;
    }
    const Command* named = find_command(header.name);
    Answer answer;
    if (named == nullptr || !decode_answer(*named, body, answer)) {
      ++refused;
      continue;
    }
    ++taken;
    for (const double x : answer.numbers) ASSERT_TRUE(std::isfinite(x));
    // Taken: then these very bytes are what the values and the error say.
    if (answer.error == 0) {
      const Bytes again = encode_answer(*named, answer);
      ASSERT_TRUE(std::equal(body.begin(), body.end(), again.begin() + kHeaderBytes, again.end()));
    }
  }
  EXPECT_GT(taken, 10000u);
  EXPECT_GT(refused, 50000u);
}

TEST(ReplyParser, AnEndlessStreamOfNoiseTakesNoMemory) {
  Random random(3);
  FrameReader reader;
  Bytes noise(4096);
  for (int i = 0; i < 2000; ++i) {
    for (std::uint8_t& byte : noise) byte = static_cast<std::uint8_t>(random.bits());
    reader.feed(noise);
    Header header;
    std::span<const std::uint8_t> body;
    while (reader.next(header, body) == FrameReader::Status::kFrame) {
    }
    ASSERT_LE(reader.waiting(), kMaxBodyBytes + kHeaderBytes + noise.size());
  }
}

TEST(RequestParser, MutatedRequestsAreRefusedOrMeanWhatTheySay) {
  Random random(4);
  for (int i = 0; i < 100000; ++i) {
    const Command& c = commands()[random.below(kCommandCount)];
    Bytes body(random.below(48));
    for (std::uint8_t& byte : body) byte = static_cast<std::uint8_t>(random.chance(0.5) ? 0 : random.bits());
    Call call;
    if (!decode_call(c, body, call)) continue;
    const Bytes again = encode_call(call);
    ASSERT_TRUE(std::equal(body.begin(), body.end(), again.begin() + kHeaderBytes, again.end())) << c.name;
  }
}

}  // namespace
}  // namespace telenano::nanonis

#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <fstream>
#include <iterator>
#include <span>
#include <string>
#include <vector>

#include "golden_messages.h"
#include "telenano/common/link/codec.h"
#include "telenano/common/link/wire_scan.h"
#include "tests/source_dir.h"

namespace telenano::link {

using Bytes = std::vector<std::uint8_t>;

inline std::vector<Bytes> golden_files() {
  std::vector<Bytes> all;
  for (const char* name : kGoldenNames) {
    std::ifstream file(std::string(TELENANO_SOURCE_DIR) + "/proto/golden/" + name + ".bin", std::ios::binary);
    all.emplace_back(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>());
  }
  return all;
}

/// A datagram by hand: header, then fields as given.
inline Bytes datagram(MessageType type, const Bytes& payload) {
  Bytes bytes(kHeaderBytes);
  write_header(std::span<std::uint8_t, kHeaderBytes>(bytes.data(), kHeaderBytes), type, payload.size());
  bytes.insert(bytes.end(), payload.begin(), payload.end());
  return bytes;
}

inline DropCause decode(const Bytes& bytes) {
  Codec codec;
  Incoming in;
  const DropCause cause = codec.decode(bytes, in);
  EXPECT_EQ(cause == DropCause::kNone, in.type != MessageType::kNone);
  return cause;
}

}  // namespace telenano::link

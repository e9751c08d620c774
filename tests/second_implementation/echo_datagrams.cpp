// What the codec makes of datagrams, for comparing it with another implementation. Standard input: datagrams,
// each after its length in two bytes, little-endian. Standard output: a line for each, its drop cause, and
// where there is none what its message encodes to, in hexadecimal.
#include <array>
#include <cstdio>
#include <vector>

#include "telenano/common/link/codec.h"
#include "tests/support/encode_incoming.h"

int main() {
  using namespace telenano::link;
  Codec codec;
  Incoming in;
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  std::array<std::uint8_t, 2> length{};
  std::vector<std::uint8_t> datagram;
  while (std::fread(length.data(), 1, 2, stdin) == 2) {
    datagram.resize(static_cast<std::size_t>(length[0]) | static_cast<std::size_t>(length[1]) << 8);
    if (std::fread(datagram.data(), 1, datagram.size(), stdin) != datagram.size()) return 1;
    std::printf("%s ", name(codec.decode(datagram, in)));
    const std::size_t size = encode(codec, in, out);
    for (std::size_t i = 0; i < size; ++i) std::printf("%02x", out[i]);
    std::printf("\n");
  }
  return 0;
}

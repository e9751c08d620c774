#include "tests/studies/bench/codec_bench.h"

#include <array>
#include <cstring>

#include "telenano/common/link/codec.h"
#include "tests/studies/bench/pinned_thread.h"
#include "tests/support/alloc_guard.h"
#include "tests/unit/link/golden_messages.h"

namespace telenano::studies {
namespace {

constexpr int kBlock = 20000;

using Buffer = std::array<std::uint8_t, link::kMaxDatagramBytes>;

/// The compiler must take `value` as read and changed.
template <class T>
void touch(T& value) {
  asm volatile("" : : "r"(&value) : "memory");
}

/// The floor: the struct into the buffer and out of it.
template <class Message>
void copy(Message& message, Buffer& buffer, Message& back) {
  touch(message);
  std::memcpy(buffer.data(), static_cast<const void*>(&message), sizeof message);
  touch(buffer);
  std::memcpy(static_cast<void*>(&back), buffer.data(), sizeof back);
  touch(back);
}

template <class Work>
double ns_each(const Work& work) {
  const std::int64_t begin_ns = clock_ns(CLOCK_THREAD_CPUTIME_ID);
  for (int i = 0; i < kBlock; ++i) work();
  return static_cast<double>(clock_ns(CLOCK_THREAD_CPUTIME_ID) - begin_ns) / kBlock;
}

BenchRow ratio(const char* what, std::vector<double> product, std::vector<double> floor) {
  return {what, "ns", median(std::move(product)), median(std::move(floor)), 2.5, false};
}

}  // namespace

std::vector<BenchRow> run_codec_bench(int rounds) {
  static_assert(sizeof(link::Command) <= link::kMaxDatagramBytes);
  static_assert(sizeof(link::Reply) <= link::kMaxDatagramBytes);
  const link::GoldenMessages golden;
  link::Codec codec;
  link::Incoming in;
  Buffer buffer{};
  struct Case {
    const char* name;
    link::Command command;
    link::Reply reply;
    std::vector<double> product, floor;
  };
  std::array<Case, 2> cases = {
      {{"exchange", golden.command, golden.reply, {}, {}},
       {"exchange_with_features", golden.command_with_features, golden.reply_with_features, {}, {}}}};
  std::uint64_t refused = 0;
  link::Command command_back;
  link::Reply reply_back;
  const auto by_codec = [&](Case& c) {
    touch(c.command);
    std::size_t n = codec.encode(c.command, buffer);
    touch(buffer);
    refused += codec.decode({buffer.data(), n}, in) == link::DropCause::kNone ? 0 : 1;
    touch(in);
    touch(c.reply);
    n = codec.encode(c.reply, buffer);
    touch(buffer);
    refused += codec.decode({buffer.data(), n}, in) == link::DropCause::kNone ? 0 : 1;
    touch(in);
  };
  std::uint64_t allocations = 0;
  for (int round = 0; round < rounds + 1; ++round) {
    for (Case& c : cases) {
      const double floor_ns = ns_each([&] {
        copy(c.command, buffer, command_back);
        copy(c.reply, buffer, reply_back);
      });
      const support::AllocGuard guard;
      const double product_ns = ns_each([&] { by_codec(c); });
      allocations += guard.allocations();
      if (round == 0) continue;  // warms up
      c.floor.push_back(floor_ns);
      c.product.push_back(product_ns);
    }
  }
  std::vector<BenchRow> rows;
  for (const Case& c : cases) rows.push_back(ratio(c.name, c.product, c.floor));
  rows.push_back({"exchange", "allocations", static_cast<double>(allocations), {}, 0.0, false});
  rows.push_back({"exchange", "refused", static_cast<double>(refused), {}, 0.0, false});
  return rows;
}

}  // namespace telenano::studies

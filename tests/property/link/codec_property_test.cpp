#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <vector>

#include "proto/telenano.pb.h"
#include "random_messages.h"
#include "telenano/common/link/codec.h"
#include "telenano/common/link/wire_scan.h"
#include "tests/unit/link/golden_messages.h"

namespace telenano::link {
namespace {

constexpr int kRounds = 100'000;

template <class Message, class Make>
void round_trip(Make make, Message Incoming::*member, MessageType type) {
  Random random(static_cast<std::uint64_t>(type));
  Codec codec;
  Incoming in;
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  std::array<std::uint8_t, kMaxDatagramBytes> again{};
  for (int i = 0; i < kRounds; ++i) {
    const Message message = make(random);
    const std::size_t n = codec.encode(message, out);
    ASSERT_GT(n, 0u);
    ASSERT_EQ(codec.decode({out.data(), n}, in), DropCause::kNone)
        << "seed " << static_cast<int>(type) << " round " << i;
    ASSERT_EQ(in.type, type);
    ASSERT_TRUE(same(in.*member, message)) << "round " << i;
    // Our own encoder is a function: the same message gives the same bytes (also says that -0.0 kept its
    // sign).
    ASSERT_EQ(codec.encode(in.*member, again), n);
    ASSERT_TRUE(std::equal(out.begin(), out.begin() + static_cast<std::ptrdiff_t>(n), again.begin()));
  }
}

TEST(RoundTrip, Hello) {
  round_trip<Hello>(any_hello, &Incoming::hello, MessageType::kHello);
}
TEST(RoundTrip, Challenge) {
  round_trip<Challenge>(any_challenge, &Incoming::challenge, MessageType::kChallenge);
}
TEST(RoundTrip, Welcome) {
  round_trip<Welcome>(any_welcome, &Incoming::welcome, MessageType::kWelcome);
}
TEST(RoundTrip, Refuse) {
  round_trip<Refuse>(any_refuse, &Incoming::refuse, MessageType::kRefuse);
}
TEST(RoundTrip, Command) {
  round_trip<Command>(any_command, &Incoming::command, MessageType::kCommand);
}
TEST(RoundTrip, CommandWithTheOnesBefore) {
  Random random(40);
  Codec codec;
  Incoming in;
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  std::array<std::uint8_t, kMaxDatagramBytes> again{};
  for (int i = 0; i < kRounds; ++i) {
    const Command message = any_command(random);
    const RecentCommands recent = any_recent(random, message.sequence);
    const std::size_t n = codec.encode(message, recent, out);
    ASSERT_GT(n, 0u);
    ASSERT_EQ(codec.decode({out.data(), n}, in), DropCause::kNone) << "round " << i;
    ASSERT_TRUE(same(in.command, message) && same(in.recent, recent)) << "round " << i;
    ASSERT_EQ(codec.encode(in.command, in.recent, again), n);
    ASSERT_TRUE(std::equal(out.begin(), out.begin() + static_cast<std::ptrdiff_t>(n), again.begin()));
  }
}
TEST(RoundTrip, Reply) {
  round_trip<Reply>(any_reply, &Incoming::reply, MessageType::kReply);
}
TEST(RoundTrip, Bye) {
  round_trip<Bye>(any_bye, &Incoming::bye, MessageType::kBye);
}
TEST(RoundTrip, SceneRequest) {
  round_trip<SceneRequest>(any_scene_request, &Incoming::scene_request, MessageType::kSceneRequest);
}
TEST(RoundTrip, SceneChunk) {
  round_trip<SceneChunk>(any_scene_chunk, &Incoming::scene_chunk, MessageType::kSceneChunk);
}
TEST(RoundTrip, SceneListAndSwitch) {
  round_trip<SceneListRequest>(any_scene_list_request, &Incoming::scene_list_request,
                               MessageType::kSceneListRequest);
  round_trip<SceneListEntry>(any_scene_list_entry, &Incoming::scene_list_entry, MessageType::kSceneListEntry);
  round_trip<SceneSwitch>(any_scene_switch, &Incoming::scene_switch, MessageType::kSceneSwitch);
}

/// Command and Reply are written without Protobuf: their bytes must be Protobuf's own, whatever is in them.
template <class Wire, class Make>
void protobuf_writes_the_same(Make make, std::uint64_t seed) {
  Random random(seed);
  Codec codec;
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  Wire wire;
  for (int i = 0; i < 20'000; ++i) {
    const std::size_t n = codec.encode(make(random), out);
    ASSERT_TRUE(wire.ParseFromArray(out.data() + kHeaderBytes, static_cast<int>(n - kHeaderBytes)));
    const std::string bytes = wire.SerializeAsString();
    ASSERT_EQ(bytes.size(), n - kHeaderBytes) << "round " << i;
    ASSERT_TRUE(std::equal(bytes.begin(), bytes.end(), out.begin() + kHeaderBytes,
                           [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; }))
        << "round " << i;
  }
}
TEST(SameAsProtobuf, Command) {
  protobuf_writes_the_same<wire::Command>(any_command, 11);
}
TEST(SameAsProtobuf, Reply) {
  protobuf_writes_the_same<wire::Reply>(any_reply, 12);
}
TEST(SameAsProtobuf, SceneChunk) {
  protobuf_writes_the_same<wire::SceneChunk>(any_scene_chunk, 13);
}
TEST(SameAsProtobuf, SceneListAndSwitch) {
  protobuf_writes_the_same<wire::SceneListRequest>(any_scene_list_request, 14);
  protobuf_writes_the_same<wire::SceneListEntry>(any_scene_list_entry, 15);
  protobuf_writes_the_same<wire::SceneSwitch>(any_scene_switch, 16);
}

/// Every datagram, cut anywhere and its length mended, ends where the memory does: who reads on does not
/// return.
TEST(Decoding, ReadsNothingBehindTheDatagram) {
  const auto page = static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
  auto* const memory = static_cast<std::uint8_t*>(
      ::mmap(nullptr, 2 * page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0));
  ASSERT_NE(memory, MAP_FAILED);
  ASSERT_EQ(::mprotect(memory + page, page, PROT_NONE), 0);
  Codec codec;
  const GoldenMessages golden;
  std::array<std::uint8_t, kMaxDatagramBytes> whole{};
  const auto cut_everywhere = [&](std::size_t size) {
    for (std::size_t n = size; n >= kHeaderBytes; --n) {
      std::uint8_t* const at = memory + page - n;
      std::copy_n(whole.begin(), n, at);
      at[6] = static_cast<std::uint8_t>((n - kHeaderBytes) & 0xff);
      at[7] = static_cast<std::uint8_t>((n - kHeaderBytes) >> 8);
      Incoming incoming;
      const DropCause cause = codec.decode({at, n}, incoming);
      EXPECT_TRUE(n < size || cause == DropCause::kNone);
    }
  };
  cut_everywhere(codec.encode(golden.command, whole));
  cut_everywhere(codec.encode(golden.command_with_features, golden.recent, whole));
  cut_everywhere(codec.encode(golden.reply, whole));
  cut_everywhere(codec.encode(golden.reply_with_history, whole));
  cut_everywhere(codec.encode(golden.reply_with_particle, whole));
  ::munmap(memory, 2 * page);
}

/// proto3 lets a sender write fields in any order: splits a message into its fields and shuffles them.
template <class Message>
void read_in_any_order(const Message& golden, Message Incoming::*member, std::size_t expected_fields) {
  Random random(5);
  Codec codec;
  Incoming in;
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  const std::size_t n = codec.encode(golden, out);
  std::vector<std::vector<std::uint8_t>> fields;
  for (std::size_t at = 8; at < n;) {
    const std::size_t size = (out[at] >= 0x80 ? 2u : 1u) + ((out[at] & 7) == 1 ? 8u : 4u);
    fields.emplace_back(out.begin() + static_cast<std::ptrdiff_t>(at),
                        out.begin() + static_cast<std::ptrdiff_t>(at + size));
    at += size;
  }
  ASSERT_EQ(fields.size(), expected_fields);
  for (int round = 0; round < 1000; ++round) {
    for (std::size_t i = fields.size(); i > 1; --i) std::swap(fields[i - 1], fields[random.below(i)]);
    std::size_t at = 8;
    for (const auto& field : fields) {
      std::copy(field.begin(), field.end(), out.begin() + static_cast<std::ptrdiff_t>(at));
      at += field.size();
    }
    ASSERT_EQ(codec.decode({out.data(), n}, in), DropCause::kNone);
    ASSERT_TRUE(same(in.*member, golden));
  }
}

TEST(Decoding, DoesNotDependOnTheOrderOfFields) {
  const GoldenMessages golden;
  read_in_any_order(golden.command_with_features, &Incoming::command, 22);
  read_in_any_order(golden.reply_with_features, &Incoming::reply, 35);
  read_in_any_order(golden.reply_with_sharing, &Incoming::reply, 23);
  read_in_any_order(golden.reply_with_history, &Incoming::reply, 36);
  read_in_any_order(golden.reply_with_particle, &Incoming::reply, 24);
}

}  // namespace
}  // namespace telenano::link

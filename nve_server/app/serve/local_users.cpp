#include "telenano/nve_server/app/serve/local_users.h"

#include <pwd.h>

#include <algorithm>
#include <bit>
#include <charconv>
#include <cstring>
#include <utility>

#include "telenano/common/base/error.h"
#include "telenano/common/link/messages.h"
#include "telenano/common/link/siphash.h"
#include "telenano/common/security/key_list.h"

namespace telenano::app {
namespace {

// A question takes the kernel some 3 µs: 2 % of the loop's time.
constexpr double kQuestionsPerS = 5000;
constexpr double kQuestionsAtOnce = 500;
constexpr int kDatagramsPerReceive = 64;

std::optional<std::uint32_t> number_of(const std::string& name) {
  std::uint32_t number = 0;
  const char* const end = name.data() + name.size();
  const auto [rest, error] = std::from_chars(name.data(), end, number);
  if (error == std::errc() && rest == end) return number;
  const passwd* const found = ::getpwnam(name.c_str());
  return found == nullptr ? std::nullopt : std::optional<std::uint32_t>(found->pw_uid);
}

// PROTOCOL.md 1: the type stands behind the four bytes of the protocol and the tag; a Hello fills its datagram.
bool is_hello(std::span<const std::uint8_t> bytes) noexcept {
  return bytes.size() == link::kMaxDatagramBytes && bytes[5] == 1;
}

}  // namespace

const LocalUserList::User* LocalUserList::find(std::uint32_t number) const noexcept {
  const auto found =
      std::find_if(users.begin(), users.end(), [&](const User& user) { return user.number == number; });
  return found == users.end() ? nullptr : &*found;
}

LocalUserList LocalUserList::parse(const std::string& text) {
  const std::string flag = "--local-users '" + text + "': ";
  LocalUserList list;
  for (std::size_t from = 0; from <= text.size();) {
    const std::size_t comma = std::min(text.find(',', from), text.size());
    const std::string one = text.substr(from, comma - from);
    from = comma + 1;
    const std::size_t colon = one.rfind(':');
    const auto rights = colon == std::string::npos ? std::nullopt : net::parse_rights(one.substr(colon + 1));
    if (!rights || colon == 0)
      throw UserError(flag + "expected USER:RIGHT,USER:RIGHT with observe, operate or administer");
    User user{one.substr(0, colon), 0, *rights, 0};
    const auto number = number_of(user.name);
    if (!number) throw UserError(flag + "there is no user '" + user.name + "' on this machine");
    user.number = *number;
    user.identity = security::identity_number('u', std::to_string(user.number));
    if (list.find(user.number) != nullptr) throw UserError(flag + "'" + user.name + "' comes twice");
    list.users.push_back(std::move(user));
  }
  return list;
}

LocalUsers::LocalUsers(LocalUserList list, std::size_t peers, const net::Address& local, net::Datagram& wire,
                       const rt::Clock& clock)
    : list_(std::move(list)),
      local_(local),
      wire_(wire),
      clock_(clock),
      questions_(kQuestionsPerS, kQuestionsAtOnce),
      known_(std::bit_ceil(std::max<std::size_t>(8 * peers, 1024))) {}

const LocalUserList::User* LocalUsers::user_of(const net::Address& from, bool anew) noexcept {
  std::array<std::uint64_t, 3> words{};
  std::memcpy(words.data(), from.ip.data(), from.ip.size());
  words[2] = from.port;
  Known& known = known_[link::siphash_words({1, 2}, words) & (known_.size() - 1)];
  const bool same = known.filled && known.address == from;
  if (same && !anew) return known.user;
  // Beyond the rate what is known stays, and a stranger is nobody: he comes again.
  if (!questions_.take(clock_.now_ns())) return same ? known.user : nullptr;
  const std::optional<std::uint32_t> number = kernel_.of(from, local_);
  known = {from, number ? list_.find(*number) : nullptr, true};
  return known.user;
}

bool LocalUsers::receive(std::span<std::uint8_t> buffer, net::Received& received) noexcept {
  for (int i = 0; i < kDatagramsPerReceive; ++i) {
    if (!wire_.receive(buffer, received)) return false;
    const bool hello = is_hello(buffer.first(std::min(received.size, buffer.size())));
    if (const LocalUserList::User* const user = user_of(received.from, hello)) {
      received.standing = {false, user->rights, user->identity};
      return true;
    }
    refused_.fetch_add(1, std::memory_order_relaxed);
  }
  return false;
}

}  // namespace telenano::app

#include "telenano/nve_server/afm/deadman_link.h"

#include <poll.h>

#include <algorithm>
#include <random>

#include "telenano/common/base/error.h"
#include "telenano/common/hash/sha256.h"
#include "telenano/common/net/tcp.h"
#include "telenano/common/net/udp.h"
#include "telenano/common/rt/steady_clock.h"
#include "telenano/nve_server/nanonis/frame_reader.h"

namespace telenano::afm {
namespace {

constexpr std::string_view kGreeting = "Telenano.Deadman", kBeat = "Telenano.Beat";
constexpr unsigned kVersion = 1;
constexpr std::size_t kNonceBytes = 16, kProofBytes = 32;

template <class Unsigned>
void put(std::string& out, Unsigned value) {
  for (int shift = 8 * (static_cast<int>(sizeof value) - 1); shift >= 0; shift -= 8)
    out += static_cast<char>(static_cast<std::uint8_t>(value >> shift));
}

std::uint64_t word(std::span<const std::uint8_t> bytes) noexcept {
  std::uint64_t value = 0;
  for (const std::uint8_t byte : bytes) value = value << 8 | byte;
  return value;
}

template <std::size_t kSize>
void put(std::string& out, const std::array<std::uint8_t, kSize>& bytes) {
  out.append(reinterpret_cast<const char*>(bytes.data()), bytes.size());
}

nanonis::Bytes frame(std::string_view name, const std::string& body) {
  std::string bytes(name);
  bytes.resize(nanonis::kNameBytes, '\0');
  put(bytes, static_cast<std::uint32_t>(body.size()));
  put(bytes, std::uint32_t{0});
  bytes += body;
  return {bytes.begin(), bytes.end()};
}

}  // namespace

std::optional<DeadmanKey> parse_deadman_key(std::string_view text) noexcept {
  while (!text.empty() && (text.back() == '\n' || text.back() == '\r' || text.back() == ' '))
    text.remove_suffix(1);
  DeadmanKey key{};
  if (text.size() != 2 * key.size()) return std::nullopt;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    const int digit = c >= '0' && c <= '9'   ? c - '0'
                      : c >= 'a' && c <= 'f' ? c - 'a' + 10
                      : c >= 'A' && c <= 'F' ? c - 'A' + 10
                                             : -1;
    if (digit < 0) return std::nullopt;
    key[i / 2] = static_cast<std::uint8_t>(key[i / 2] << 4 | digit);
  }
  return key;
}

void DeadmanLink::restart() noexcept {
  greeted_ = broken_ = false;
  number_ = answers_ = 0;
  state_ = DeadmanState::kReady;
}

bool DeadmanLink::feed(const nanonis::Header& header, std::span<const std::uint8_t> body) {
  if (header.name == kGreeting) {
    on_greeting(body);
    return true;
  }
  if (header.name == kBeat) {
    on_answer(body);
    return true;
  }
  return false;
}

void DeadmanLink::on_greeting(std::span<const std::uint8_t> body) noexcept {
  if (greeted_ || body.size() != 4 + kNonceBytes || word(body.first(2)) != kVersion) {
    broken_ = true;
    return;
  }
  silence_ms_ = static_cast<int>(word(body.subspan(2, 2)));
  std::copy(body.begin() + 4, body.end(), greeting_.begin());
  greeted_ = true;
}

void DeadmanLink::on_answer(std::span<const std::uint8_t> body) {
  broken_ = true;
  if (!greeted_ || body.size() != 10 + kProofBytes || word(body.first(8)) != number_ || number_ == 0) return;
  const std::uint64_t state = word(body.subspan(8, 2));
  if (state > static_cast<std::uint64_t>(DeadmanState::kNoController)) return;
  std::string text = "Telenano answer 1";
  put(text, greeting_);
  put(text, nonce_);
  put(text, number_);
  put(text, static_cast<std::uint16_t>(state));
  const auto proof = hmac_sha256(key_, text);
  unsigned differs = 0;  // in a time that tells nothing
  for (std::size_t i = 0; i < kProofBytes; ++i) differs |= static_cast<unsigned>(proof[i] ^ body[10 + i]);
  if (differs != 0) return;
  broken_ = false;
  ++answers_;
  answered_beat_ = beat_;
  state_ = static_cast<DeadmanState>(state);
}

nanonis::Bytes DeadmanLink::beat(DeadmanBeat what) {
  ++number_;
  beat_ = what;
  std::string text = "Telenano beat 1";
  put(text, greeting_);
  put(text, nonce_);
  put(text, number_);
  put(text, static_cast<std::uint16_t>(what));
  std::string body;
  put(body, nonce_);
  put(body, number_);
  put(body, static_cast<std::uint16_t>(what));
  put(body, hmac_sha256(key_, text));
  return frame(kBeat, body);
}

std::array<std::uint8_t, 16> fresh_nonce() {
  std::random_device device;
  std::array<std::uint8_t, 16> nonce{};
  for (std::uint8_t& byte : nonce) byte = static_cast<std::uint8_t>(device());
  return nonce;
}

void meet_deadman(const net::Address& address, const DeadmanKey& key) {
  constexpr std::int64_t kPatienceNs = 2'000'000'000;
  const std::string where = "the deadman at " + net::to_string(address);
  const std::string run = "; run deadman.py on the controller's computer (or serve --without-deadman)";
  net::TcpStream stream;
  try {
    stream = net::TcpStream::connect(address, kPatienceNs);
  } catch (const RunError& error) {
    throw UserError(where + ": " + error.what() + run);
  }
  DeadmanLink link(key, fresh_nonce());
  nanonis::FrameReader reader;
  const rt::SteadyClock clock;
  bool beaten = false;
  for (const std::int64_t end_ns = clock.now_ns() + kPatienceNs; clock.now_ns() < end_ns;) {
    std::array<std::uint8_t, 4096> buffer;
    std::size_t n = 0;
    const auto status = stream.read(buffer, n);
    if (status == net::TcpStream::Status::kClosed)
      throw UserError(beaten ? where + " refuses the key: [deadman] key must be a copy of its own"
                             : where + " closed the connection" + run);
    if (status == net::TcpStream::Status::kWouldBlock) {
      pollfd entry{stream.handle(), POLLIN, 0};
      ::poll(&entry, 1, 50);
      continue;
    }
    reader.feed(std::span(buffer).first(n));
    nanonis::Header header;
    std::span<const std::uint8_t> body;
    for (;;) {
      const auto next = reader.next(header, body);
      if (next == nanonis::FrameReader::Status::kNeedMore) break;
      if (next == nanonis::FrameReader::Status::kBroken || !link.feed(header, body) || link.broken())
        throw UserError(
            where +
            (beaten ? " does not prove that it has the key: [deadman] key must be a copy of the deadman's key"
                    : ": the program that answers there is not a deadman of this version; --ports lists "
                      "motion, reads, data and the deadman's port"));
    }
    if (link.answers() > 0) break;
    if (!link.greeted() || beaten) continue;
    beaten = true;
    if (stream.write(link.beat(DeadmanBeat::kQuiet), n) != net::TcpStream::Status::kOk)
      throw UserError(where + " closed the connection" + run);
  }
  if (link.answers() == 0)
    throw UserError(where +
                    " does not answer: is that the controller itself? --ports lists motion, reads, data and "
                    "the deadman's port" +
                    (beaten ? "" : run));
  switch (link.state()) {
    case DeadmanState::kReady:
      return;
    case DeadmanState::kLatched:
      throw UserError(where + " has withdrawn the tip: look at it, then run deadman.py clear there");
    case DeadmanState::kInUse:
      throw UserError(where + " guards another server: stop that server first");
    case DeadmanState::kNoController:
      throw UserError(where +
                      " does not reach the controller's emergency port: check `controller` in its "
                      "deadman.toml, and whether another program uses that port");
  }
}

}  // namespace telenano::afm

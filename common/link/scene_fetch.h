#pragma once

#include <algorithm>
#include <cstdint>
#include <deque>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "telenano/common/link/messages.h"

namespace telenano::link {

struct SceneFetchLimits {
  std::uint32_t bytes_max = (1u << 24) + (1u << 20);  ///< a larger bundle is not fetched
  double requests_max_per_s = 1500;          ///< 5.6 Mbit/s of pieces; a link that loses more gets fewer
  std::int64_t give_up_ns = 20'000'000'000;  ///< without a new piece while the session is up
};

/// Which pieces of a scene's bundle a station asks for, and when: datagrams and times by others. One request
/// is one piece of at most kSceneChunkBytes; each is asked for again until it has come. Of what comes, only
/// pieces that were asked for and are not there yet count, so that memory is that of the bundle, whose size
/// is known and bounded before the first.
///
/// How fast: no more than `requests_max_per_s`, and no more under way than two round trips explain. A piece
/// that has not come after the round trip and four times its deviation is lost. Of each 16 outcomes more than
/// an eighth lost: half as fast; else half as fast again. So 2 % of chance losses cost nothing, and a link
/// that is full, or has no session for a while, is left alone but for a few requests a second. Never
/// faster than set_link_most() says, which knows of queues.
///
/// What it holds stays over offer() of the same bundle: a resumed session goes on where the last one was. It
/// allocates, and is no part of a loop.
class SceneFetch {
 public:
  enum class State : std::uint8_t { kIdle, kFetching, kDone, kTooLarge, kGivenUp };

  explicit SceneFetch(const SceneFetchLimits& limits = {}) : limits_(limits) {}

  /// What the newest Welcome offers: another bundle than before is begun from nothing; an empty offer ends.
  void offer(const SceneOffer& scene, std::int64_t now_ns);
  /// May requests be answered? While not, nothing is asked for and nothing counts as lost.
  void set_up(bool up, std::int64_t now_ns) noexcept;
  /// Requests a second that the link has room for; above 0. requests_max_per_s bounds it until it is said.
  void set_link_most(double per_s) noexcept { link_most_per_s_ = per_s; }
  /// The piece to ask for now; call until there is none, every millisecond or so.
  std::optional<std::uint32_t> next(std::int64_t now_ns);
  /// A piece has come. True if it was wanted.
  bool take(std::uint32_t chunk, std::span<const std::uint8_t> data, std::int64_t now_ns);

  State state() const noexcept { return state_; }
  const SceneOffer& scene() const noexcept { return scene_; }
  /// All of it in kDone. That its hash is right is for the caller to see.
  const std::vector<std::uint8_t>& bytes() const noexcept { return bytes_; }
  std::uint32_t have() const noexcept { return have_; }  ///< pieces
  double rate_per_s() const noexcept { return std::min(rate_per_s_, link_most_per_s_); }
  std::uint64_t requests() const noexcept { return requests_; }

 private:
  struct Piece {
    std::int64_t asked_ns = 0;
    std::uint32_t times = 0;
    bool here = false;
  };
  struct UnderWay {
    std::uint32_t chunk = 0;
    std::int64_t asked_ns = 0;
  };

  void outcome(bool lost) noexcept;
  void find_lost(std::int64_t now_ns);
  std::int64_t patience_ns() const noexcept;

  SceneFetchLimits limits_;
  State state_ = State::kIdle;
  SceneOffer scene_;
  std::vector<std::uint8_t> bytes_;
  std::vector<Piece> pieces_;
  std::deque<UnderWay> under_way_;  ///< by the time of asking; what came is skipped
  std::size_t open_ = 0;            ///< of these, neither come nor lost
  std::deque<std::uint32_t> again_;
  std::uint32_t first_unasked_ = 0;
  std::uint32_t have_ = 0;
  bool up_ = false;
  double rate_per_s_ = 0;  ///< by loss alone
  double link_most_per_s_ = std::numeric_limits<double>::infinity();
  double credit_ = 0;
  std::int64_t credit_ns_ = 0;
  std::int64_t news_ns_ = 0;
  double rtt_ns_ = 0;  ///< smoothed, as RFC 6298; 0: not measured yet
  double rtt_var_ns_ = 0;
  int outcomes_ = 0;
  int lost_ = 0;
  std::uint64_t requests_ = 0;
};

}  // namespace telenano::link

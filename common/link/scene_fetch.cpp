#include "telenano/common/link/scene_fetch.h"

#include <algorithm>
#include <cmath>

namespace telenano::link {
namespace {

constexpr double kRateFirst_per_s = 500;
constexpr double kRateLeast_per_s = 20;
constexpr double kBurst = 4;
constexpr int kOutcomes = 16;
constexpr std::int64_t kPatienceFirstNs = 300'000'000;
constexpr std::int64_t kPatienceLeastNs = 20'000'000;
constexpr std::int64_t kPatienceMostNs = 2'000'000'000;

}  // namespace

void SceneFetch::offer(const SceneOffer& scene, std::int64_t now_ns) {
  news_ns_ = credit_ns_ = now_ns;
  if (scene == scene_) {
    // The same again, in another session: what was under way there is not answered any more.
    for (const UnderWay& request : under_way_) {
      const Piece& piece = pieces_[request.chunk];
      if (!piece.here && piece.asked_ns == request.asked_ns) again_.push_back(request.chunk);
    }
    under_way_.clear();
    open_ = 0;
    if (state_ == State::kGivenUp) state_ = State::kFetching;
    return;
  }
  scene_ = scene;
  bytes_.clear();
  pieces_.clear();
  under_way_.clear();
  again_.clear();
  open_ = 0;
  first_unasked_ = have_ = 0;
  outcomes_ = lost_ = 0;
  credit_ = 0;
  rate_per_s_ = std::min(kRateFirst_per_s, limits_.requests_max_per_s);
  state_ = scene.empty()                     ? State::kIdle
           : scene.bytes > limits_.bytes_max ? State::kTooLarge
                                             : State::kFetching;
  if (state_ != State::kFetching) return;
  bytes_.resize(scene.bytes);
  pieces_.resize(scene.chunks());
}

void SceneFetch::set_up(bool up, std::int64_t now_ns) noexcept {
  if (up && !up_) news_ns_ = credit_ns_ = now_ns;
  up_ = up;
}

std::int64_t SceneFetch::patience_ns() const noexcept {
  if (rtt_ns_ == 0) return kPatienceFirstNs;
  const auto explained = static_cast<std::int64_t>(rtt_ns_ + 4 * rtt_var_ns_) + 5'000'000;
  return std::clamp(explained, kPatienceLeastNs, kPatienceMostNs);
}

void SceneFetch::outcome(bool lost) noexcept {
  lost_ += lost ? 1 : 0;
  if (++outcomes_ < kOutcomes) return;
  const double change = 8 * lost_ > outcomes_ ? 0.5 : 1.5;
  rate_per_s_ = std::clamp(rate_per_s_ * change, std::min(kRateLeast_per_s, limits_.requests_max_per_s),
                           limits_.requests_max_per_s);
  outcomes_ = lost_ = 0;
}

void SceneFetch::find_lost(std::int64_t now_ns) {
  const std::int64_t patience = patience_ns();
  while (!under_way_.empty()) {
    const UnderWay request = under_way_.front();
    const Piece& piece = pieces_[request.chunk];
    const bool open = !piece.here && piece.asked_ns == request.asked_ns;
    if (open && now_ns - request.asked_ns <= patience) return;
    under_way_.pop_front();
    if (!open) continue;
    again_.push_back(request.chunk);
    --open_;
    outcome(true);
  }
}

std::optional<std::uint32_t> SceneFetch::next(std::int64_t now_ns) {
  if (state_ != State::kFetching || !up_) return std::nullopt;
  find_lost(now_ns);
  if (now_ns - news_ns_ > limits_.give_up_ns) {
    state_ = State::kGivenUp;
    return std::nullopt;
  }
  credit_ = std::min(kBurst, credit_ + 1e-9 * static_cast<double>(now_ns - credit_ns_) * rate_per_s());
  credit_ns_ = now_ns;
  const double most =
      2e-9 * rate_per_s() * (rtt_ns_ > 0 ? rtt_ns_ : static_cast<double>(kPatienceFirstNs)) + 8;
  if (credit_ < 1 || static_cast<double>(open_) >= most) return std::nullopt;
  while (!again_.empty() && pieces_[again_.front()].here) again_.pop_front();
  std::uint32_t chunk = first_unasked_;
  if (!again_.empty()) {
    chunk = again_.front();
    again_.pop_front();
  } else if (first_unasked_ < pieces_.size()) {
    ++first_unasked_;
  } else {
    return std::nullopt;
  }
  credit_ -= 1;
  ++requests_;
  ++open_;
  Piece& piece = pieces_[chunk];
  piece.asked_ns = now_ns;
  ++piece.times;
  under_way_.push_back({chunk, now_ns});
  return chunk;
}

bool SceneFetch::take(std::uint32_t chunk, std::span<const std::uint8_t> data, std::int64_t now_ns) {
  if (state_ != State::kFetching || chunk >= pieces_.size()) return false;
  Piece& piece = pieces_[chunk];
  if (piece.here || piece.times == 0 || data.size() != scene_.chunk_bytes(chunk)) return false;
  std::copy(data.begin(), data.end(), bytes_.begin() + static_cast<std::ptrdiff_t>(chunk * kSceneChunkBytes));
  piece.here = true;
  news_ns_ = now_ns;
  // Asked for once, its way is known; else it may answer either (Karn).
  if (piece.times == 1) {
    const auto took_ns = static_cast<double>(std::max<std::int64_t>(now_ns - piece.asked_ns, 1));
    rtt_var_ns_ = rtt_ns_ == 0 ? took_ns / 2 : 0.75 * rtt_var_ns_ + 0.25 * std::fabs(rtt_ns_ - took_ns);
    rtt_ns_ = rtt_ns_ == 0 ? took_ns : 0.875 * rtt_ns_ + 0.125 * took_ns;
  }
  const bool open = std::any_of(under_way_.begin(), under_way_.end(), [&](const UnderWay& request) {
    return request.chunk == chunk && request.asked_ns == piece.asked_ns;
  });
  if (open) --open_;
  outcome(false);
  if (++have_ == pieces_.size()) state_ = State::kDone;
  return true;
}

}  // namespace telenano::link

#include "telenano/master/scene/scene_keeper.h"

#include <sys/stat.h>

#include <chrono>
#include <exception>
#include <span>
#include <utility>

#include "telenano/common/base/version.h"
#include "telenano/common/rt/signals_blocked.h"
#include "telenano/common/rt/steady_clock.h"

namespace telenano::scene_store {
namespace {

constexpr std::chrono::milliseconds kWhileFetching(1);
constexpr std::chrono::milliseconds kElse(20);
// A check that nobody waits for any more takes its process with it; as many are made before there are threads.
constexpr int kProcesses = 3;

/// Tells one build of this program from another: what one finds in a scene (the bits of a motion) another
/// need not.
const std::string& this_program() {
  static const std::string name = [] {
    std::string text = std::string(kVersion) + " " + kGitCommit;
    struct stat about {};
    if (::stat("/proc/self/exe", &about) == 0)
      text += " " + std::to_string(about.st_size) + " " + std::to_string(about.st_mtim.tv_sec) + "." +
              std::to_string(about.st_mtim.tv_nsec);
    return hex(sha256(text)).substr(0, 16);
  }();
  return name;
}

}  // namespace

Sha256 hash_of(const link::SceneOffer& offer) noexcept {
  Sha256 hash{};
  for (std::size_t i = 0; i < hash.size(); ++i)
    hash[i] = static_cast<std::uint8_t>(offer.hash[i / 8] >> (8 * (i % 8)));
  return hash;
}

SceneKeeper::SceneKeeper(SceneKeeperOptions options)
    : options_(std::move(options)),
      cache_(options_.cache),
      checker_(options_.check_memory_bytes, options_.check_most_seconds, kProcesses),
      fetch_(options_.limits) {}

SceneKeeper::~SceneKeeper() {
  stop_.store(true, std::memory_order_release);
  checker_.stop();  // a look may take long, and nobody waits for it any more
  if (thread_.joinable()) thread_.join();
}

void SceneKeeper::start() {
  if (thread_.joinable()) return;
  const rt::SignalsBlocked blocked;  // signals are for the main thread
  thread_ = std::thread([this] { run(); });
}

std::shared_ptr<const StationScene> SceneKeeper::scene() const {
  const std::lock_guard lock(mutex_);
  return scene_;
}

std::shared_ptr<const std::string> SceneKeeper::bundle() const {
  const std::lock_guard lock(mutex_);
  return bundle_;
}

std::shared_ptr<const surface::HeightGrid> SceneKeeper::ground() const {
  const std::lock_guard lock(mutex_);
  return ground_;
}

SceneNews SceneKeeper::news() const {
  const std::lock_guard lock(mutex_);
  return news_;
}

void SceneKeeper::show_shape(SceneShape shape) {
  const std::lock_guard lock(mutex_);
  news_.tip_radius_nm = shape.tip_radius_nm;
  if (!shape.heights.z_nm.empty())
    ground_ = std::make_shared<const surface::HeightGrid>(std::move(shape.heights));
}

void SceneKeeper::check_goes_on(const std::string& bundle) {
  checker_.give_way();
  const std::string words = "the server's scene is still being checked after " +
                            std::to_string(options_.check_seconds) +
                            " s: the check goes on at low priority, and the scene is used once it ends well";
  {
    const std::lock_guard lock(mutex_);
    news_.check = SceneNews::Check::kGoesOn;
    news_.words = words;
  }
  if (options_.warn) options_.warn(words);
  // A session that ends before the check does need not have fetched it for nothing.
  cache_.keep(hash_of(offered_), bundle);
}

void SceneKeeper::give_up(const std::string& why) {
  if (stop_.load(std::memory_order_acquire)) return;
  const std::string words = "the server's scene cannot be used: " + why + "; the session goes on without";
  {
    const std::lock_guard lock(mutex_);
    ground_.reset();  // drawn before it was looked at
    news_ = {SceneNews::Check::kUnusable, words, 0};
  }
  if (options_.warn) options_.warn(words);
  // Last: who sees it may ask at once what was said.
  settled_.store(true, std::memory_order_release);
}

void SceneKeeper::take_offer(const loop::OfferedScene& offer, std::int64_t now_ns) {
  const bool same = offer.scene == offered_;
  offered_ = offer.scene;
  if (same && (settled_.load(std::memory_order_relaxed) || fetch_.state() == link::SceneFetch::State::kDone))
    return;
  if (!same) {
    const std::lock_guard lock(mutex_);
    scene_.reset();
    bundle_.reset();
    ground_.reset();
    news_ = {};
    fetched_.store(0, std::memory_order_relaxed);
  }
  settled_.store(false, std::memory_order_release);
  if (offered_.empty()) {
    fetch_.offer({}, now_ns);
    settled_.store(true, std::memory_order_release);
    return;
  }
  if (!has_sha256()) return give_up("this program was built without OpenSSL");
  if (!same) {
    if (auto kept = cache_.read(hash_of(offered_), offered_.bytes);
        kept && offered_.bytes <= options_.limits.bytes_max) {
      fetch_.offer({}, now_ns);
      return use(std::move(*kept), true);
    }
  }
  fetch_.offer(offered_, now_ns);
  if (fetch_.state() == link::SceneFetch::State::kTooLarge)
    give_up("it has " + std::to_string(offered_.bytes) + " bytes, expected at most " +
            std::to_string(options_.limits.bytes_max));
}

void SceneKeeper::use(std::string bundle, bool cached) {
  const auto bytes = std::make_shared<const std::string>(std::move(bundle));
  if (sha256(*bytes) != hash_of(offered_))
    return give_up("the data received does not have the announced hash");
  {
    const std::lock_guard lock(mutex_);
    bundle_ = bytes;
  }
  auto scene = std::make_shared<StationScene>();
  scene->offer = offered_;
  scene->bundle = *bytes;
  const Sha256 hash = hash_of(offered_);
  std::string why;
  // Looking takes as long as making the scene. What this very program has found it need not look for again.
  const auto found = cached ? cache_.read_finding(hash, this_program()) : std::nullopt;
  const auto late = std::chrono::steady_clock::now() + std::chrono::seconds(options_.check_seconds);
  bool goes_on = false;
  bool left = false;  // for another scene
  const auto still_wanted = [&] {
    if (!goes_on && std::chrono::steady_clock::now() >= late) {
      goes_on = true;
      check_goes_on(*bytes);
    }
    left = goes_on && !(pipe_.offer.load().scene == offered_);
    return !left;
  };
  try {
    if (!found) show_shape(checker_.shape_of(*bytes, still_wanted));
    const std::string finding = found ? *found : checker_.look_at(*bytes, still_wanted);
    scene->checked = read_finding(finding);
    if (!cached) why = cache_.keep(hash, *bytes);
    if (!found && why.empty()) why = cache_.keep_finding(hash, this_program(), finding);
  } catch (const std::exception& error) {
    if (left) return;
    return give_up(error.what());
  }
  if (!why.empty() && options_.note) options_.note(why);
  if (goes_on && options_.note) options_.note("the server's scene is checked now, and used");
  scene->same_physics = scene->checked.canonical_motion == offered_.canonical_motion;
  {
    const std::lock_guard lock(mutex_);
    // The same again is no other picture.
    if (ground_ == nullptr || ground_->z_nm != scene->checked.ground.z_nm)
      ground_ = std::shared_ptr<const surface::HeightGrid>(scene, &scene->checked.ground);
    news_ = {SceneNews::Check::kQuiet, "", scene->checked.tip_radius_nm};
    scene_ = std::move(scene);
  }
  settled_.store(true, std::memory_order_release);
}

void SceneKeeper::run() {
  const rt::SteadyClock clock;
  std::uint64_t offers_seen = 0;
  bool begun = false;
  loop::OfferedScene offer;
  loop::ScenePiece piece;
  using State = link::SceneFetch::State;
  while (!stop_.load(std::memory_order_acquire)) {
    const std::int64_t now_ns = clock.now_ns();
    if (const std::uint64_t count = pipe_.offer.count(); count != offers_seen) {
      offers_seen = count;
      const loop::OfferedScene newest = pipe_.offer.load();
      const bool another_session = !begun || newest.sessions != offer.sessions;
      begun = true;
      offer = newest;
      if (another_session && offer.sessions > 0) take_offer(offer, now_ns);
      fetch_.set_up(offer.up, now_ns);
    }
    while (pipe_.pieces.pop(piece)) {
      if (piece.bundle == fetch_.scene().name())
        fetch_.take(piece.chunk, std::span(piece.data).first(piece.size), now_ns);
    }
    if (const std::uint32_t chunks = fetch_.scene().chunks(); chunks > 0)
      fetched_.store(static_cast<double>(fetch_.have()) / chunks, std::memory_order_relaxed);
    fetch_.set_link_most(pipe_.link_most_per_s.load(std::memory_order_relaxed));
    while (const auto chunk = fetch_.next(now_ns)) pipe_.requests.push({fetch_.scene().name(), *chunk});
    if (!settled_.load(std::memory_order_relaxed) && fetch_.state() == State::kDone)
      use({fetch_.bytes().begin(), fetch_.bytes().end()}, false);
    if (!settled_.load(std::memory_order_relaxed) && fetch_.state() == State::kGivenUp)
      give_up("the server does not send it");
    std::this_thread::sleep_for(fetch_.state() == State::kFetching ? kWhileFetching : kElse);
  }
}

}  // namespace telenano::scene_store

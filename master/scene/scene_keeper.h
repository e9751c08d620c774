#pragma once

#include <atomic>
#include <condition_variable>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "telenano/common/link/scene_fetch.h"
#include "telenano/common/surface/height_grid.h"
#include "telenano/master/loop/scene_pipe.h"
#include "telenano/master/scene/scene_cache.h"
#include "telenano/master/scene/scene_check.h"

namespace telenano::scene_store {

/// The scene that a session is about, once it is here and was looked at.
struct StationScene {
  link::SceneOffer offer;
  std::string bundle;  ///< has the offer's hash
  CheckedScene checked;
  /// The server's physics give this scene the same bits as this program's: a slave built here may be shown.
  bool same_physics = false;
};

/// What a person is to know of the scene of the newest Welcome.
struct SceneNews {
  enum class Check : std::uint8_t {
    kQuiet,     ///< there is nothing to say: it is used, on its way, or was never offered
    kGoesOn,    ///< it takes longer than usual; what is drawn is not proven yet
    kUnusable,  ///< it cannot be had, or must not be used
  };
  Check check = Check::kQuiet;
  std::string words;         ///< one line; empty: nothing to say
  double tip_radius_nm = 0;  ///< 0: not known
};

struct SceneKeeperOptions {
  std::filesystem::path cache = SceneCache::users_folder();
  link::SceneFetchLimits limits;
  /// One line for a person, from the keeper's thread: once for each offer that comes to nothing, and once for each
  /// whose check takes long.
  std::function<void(const std::string&)> warn;
  /// Likewise, of less weight.
  std::function<void(const std::string&)> note;
  std::size_t check_memory_bytes = SceneChecker::kMemoryBytes;
  int check_seconds = 60;  ///< after which a check goes on behind all else, until another scene is offered
  int check_most_seconds = 3600;  ///< of the processor's time, for the checks of a process
};

/// Gets the scene that the server offers: from the cache, else piece by piece over the session; looks at it
/// in a process of its own; keeps it. All in a thread of its own: the loop only feeds `pipe()`. Whatever goes
/// wrong is one line, and the session goes on without. A check that takes long is nothing wrong: it goes on, and what
/// is drawn stays.
class SceneKeeper {
 public:
  /// Forks (SceneChecker): construct it before there are threads. start() begins the work, once.
  explicit SceneKeeper(SceneKeeperOptions options);
  ~SceneKeeper();
  SceneKeeper(const SceneKeeper&) = delete;
  SceneKeeper& operator=(const SceneKeeper&) = delete;
  void start();

  loop::ScenePipe& pipe() noexcept { return pipe_; }

  /// Any thread that may wait. The scene of the newest Welcome; null: not here, or not to be used.
  std::shared_ptr<const StationScene> scene() const;
  /// The bytes of it, which have the right hash but may not have been looked at yet; null: not here.
  std::shared_ptr<const std::string> bundle() const;
  /// The surface as it is drawn: that of a scan as soon as its bytes are here, else once the scene was looked
  /// at. Null: not here, or not to be used; no heights: a plane.
  std::shared_ptr<const surface::HeightGrid> ground() const;
  SceneNews news() const;
  /// How much of the scene is here, 0 … 1.
  double fetched() const noexcept { return fetched_.load(std::memory_order_relaxed); }
  /// Nothing is on its way any more: it is here, cannot be had, or was never offered.
  bool settled() const noexcept { return settled_.load(std::memory_order_acquire); }

 private:
  void run();
  void take_offer(const loop::OfferedScene& offer, std::int64_t now_ns);
  void use(std::string bundle, bool cached);
  void show_shape(SceneShape shape);
  void check_goes_on(const std::string& bundle);
  void give_up(const std::string& why);

  SceneKeeperOptions options_;
  SceneCache cache_;
  SceneChecker checker_;
  loop::ScenePipe pipe_;
  link::SceneFetch fetch_;
  link::SceneOffer offered_;
  mutable std::mutex mutex_;
  std::shared_ptr<const StationScene> scene_;
  std::shared_ptr<const std::string> bundle_;
  std::shared_ptr<const surface::HeightGrid> ground_;
  SceneNews news_;
  std::atomic<double> fetched_{0};
  std::atomic<bool> settled_{false};
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

/// The SHA-256 that an offer names.
Sha256 hash_of(const link::SceneOffer& offer) noexcept;

}  // namespace telenano::scene_store

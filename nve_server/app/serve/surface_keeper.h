#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "telenano/nve_server/slave/nve_slave.h"

namespace telenano::app {

/// Keeps what sessions leave in their samples: FOLDER/<scene>-<number>.gsf. Numbers go on after those that
/// are in the folder at the start, in the order in which sessions open; a session without marks leaves no
/// file. No file is ever overwritten but a session's own: one that another program has made meanwhile makes
/// the session take the next free number.
///
/// Each file is written every kSavePeriod in which marks came, and when its session is forgotten (after its
/// Bye, or when it can no longer be resumed) or at shutdown, beside its place, brought to the disk and then
/// put there: a server that is killed has lost what came since, and no more. What it leaves then may have a
/// FILE.part beside it, which is nothing.
///
/// The server's loops only note each mark in a queue; a thread of its own presses them into a copy of the
/// surface, writes, and says on standard error what it could not write.
class SurfaceKeeper {
 public:
  static constexpr std::chrono::seconds kSavePeriod{2};

  /// Throws UserError unless `folder` is a folder.
  SurfaceKeeper(std::shared_ptr<const scene::Scene> scene, std::string folder);
  /// Writes what is left.
  ~SurfaceKeeper();
  SurfaceKeeper(const SurfaceKeeper&) = delete;
  SurfaceKeeper& operator=(const SurfaceKeeper&) = delete;

  /// A slave that comes to `keeper` when it is destroyed; it keeps the keeper alive.
  static std::unique_ptr<slave::Slave> make_slave(const std::shared_ptr<SurfaceKeeper>& keeper);

 private:
  struct Kept;
  class KeptSlave;

  std::shared_ptr<Kept> begin(const slave::NveSlave& slave, const std::shared_ptr<Kept>& instead);
  void take(std::shared_ptr<Kept> kept, std::unique_ptr<slave::NveSlave> slave) noexcept;
  void run();
  void follow(Kept& kept) const;
  void save(Kept& kept, const physics::SplineSurface& surface);
  std::string file_of(int number) const;

  std::shared_ptr<const scene::Scene> scene_;
  std::string folder_;
  std::function<std::unique_ptr<slave::NveSlave>()> slaves_;
  std::atomic<int> numbers_{0};  // given out; by the loops of several workers
  std::mutex mutex_;             // held for a moment only: loops wait for it when sessions come and go
  std::condition_variable wake_;
  std::vector<std::shared_ptr<Kept>> sessions_;
  bool news_ = false;  // a session is over
  bool done_ = false;
  std::thread thread_;
};

}  // namespace telenano::app

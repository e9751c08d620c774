#pragma once

#include <atomic>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "nve_server/slave/nve_slave.h"

namespace telenano::app {

/// Keeps what sessions leave in their samples: FOLDER/<scene>-<number>.gsf, the number that of the session in
/// the order of their openings since the start. A session without marks leaves no file.
///
/// The server's loop only hands over a slave when its session is forgotten (after its Bye, or when it can no
/// longer be resumed) or at shutdown; a thread of its own writes, and says on standard error what it could
/// not write.
class SurfaceKeeper {
 public:
  /// Throws UserError unless `folder` is a folder.
  SurfaceKeeper(std::shared_ptr<const scene::Scene> scene, std::string folder);
  /// Writes what is left.
  ~SurfaceKeeper();
  SurfaceKeeper(const SurfaceKeeper&) = delete;
  SurfaceKeeper& operator=(const SurfaceKeeper&) = delete;

  /// A slave that comes to `keeper` when it is destroyed; it keeps the keeper alive.
  static std::unique_ptr<slave::Slave> make_slave(const std::shared_ptr<SurfaceKeeper>& keeper);

 private:
  struct Left {
    int number = 0;
    std::unique_ptr<slave::NveSlave> slave;
  };
  class KeptSlave;

  void take(Left left) noexcept;
  void run();
  void write(const Left& left) const;

  std::shared_ptr<const scene::Scene> scene_;
  std::string folder_;
  std::function<std::unique_ptr<slave::NveSlave>()> slaves_;
  std::atomic<int> made_{0};  // by the loops of several workers
  std::mutex mutex_;
  std::condition_variable wake_;
  std::vector<Left> left_;
  bool done_ = false;
  std::thread thread_;
};

}  // namespace telenano::app

#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <memory>
#include <string>

#include "telenano/common/rt/clock.h"
#include "telenano/nve_server/server/server.h"

namespace CLI {
class App;
}
namespace telenano::afm {
class AfmExchange;
}
namespace telenano::metrics {
class Page;
}

namespace telenano::app {

/// `--slave NAME` of a controller (nve_server/afm/afm_adapters.h): an AFM behind it instead of a scene.
class ServeAfm {
 public:
  ServeAfm();
  ~ServeAfm();
  void add_flags(CLI::App& command);
  bool wanted() const noexcept { return slave_ != "nve"; }
  /// Throws UserError for flags that do not go together.
  void check(const std::string& scene, const std::string& share) const;
  /// What is served, for the log.
  std::string served(const std::string& scene) const { return wanted() ? "an AFM" : scene; }
  /// Starts the guard and the controller's thread, checks and approaches. Throws UserError, one line.
  /// `realtime_priority`: of that thread, SCHED_FIFO; 0: ordinary scheduling.
  server::ServedScene start(const rt::Clock& clock, const std::atomic<bool>& stop, int realtime_priority,
                            std::function<void(const std::string&)> news);
  /// What the controller's thread has published. From any thread; nothing before there was anything.
  void write_metrics(metrics::Page& page) const;
  /// Withdraws the tip. Also when the object goes.
  void stop();

 private:
  struct Running;
  std::shared_ptr<afm::AfmExchange> exchange_;
  std::string slave_ = "nve";
  std::string controller_;
  std::string ports_ = "6501-6504";
  std::string afm_;
  std::string state_;
  bool without_deadman_ = false;
  std::unique_ptr<Running> running_;
};

/// `afm approve`: an operator's word that the tip may approach again after a server that did not end with it
/// withdrawn.
CLI::App* add_afm_command(CLI::App& app);

/// The hidden `afm-guard`, which the server starts itself (nve_server/afm/guard.h).
void add_afm_guard_command(CLI::App& app, int& exit_code);

}  // namespace telenano::app

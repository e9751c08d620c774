#pragma once

#include <array>
#include <functional>
#include <memory>
#include <string>
#include <utility>

#include "telenano/nve_server/app/serve/serve_workers.h"
#include "telenano/nve_server/slave/slave.h"
#include "telenano/nve_server/web/tip_slots.h"

namespace telenano::app {

/// Lets `slots` see each slave that `make` makes, at most 60 times a second of its own time: one wait-free
/// store each. Tips beyond TipSlots::kSlots are served as they are.
std::function<std::unique_ptr<slave::Slave>()> watched(std::function<std::unique_ptr<slave::Slave>()> make,
                                                       std::shared_ptr<web::TipSlots> slots);

/// One picture for the browsers, as JSON: mode, number of sessions, and the tips that moved lately.
class WebState {
 public:
  WebState(const Workers& workers, std::shared_ptr<web::TipSlots> slots, bool afm)
      : workers_(workers), slots_(std::move(slots)), afm_(afm) {}
  std::string next();

 private:
  struct Seen {
    std::uint64_t count = 0;
    int quiet = 1000;  ///< pictures since it moved
  };
  const Workers& workers_;
  std::shared_ptr<web::TipSlots> slots_;
  bool afm_;
  std::array<Seen, web::TipSlots::kSlots> seen_{};
};

}  // namespace telenano::app

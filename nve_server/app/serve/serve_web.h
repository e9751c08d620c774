#pragma once

#include <array>
#include <cstdint>
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

/// One picture for the browsers, as JSON: mode, number of sessions, the tips that moved lately, and a number
/// that changes with the marks in the sample of the first of them. For one thread.
class WebState {
 public:
  /// `unmarked`: the scene's surface, as fine as it is shown; empty: not known.
  WebState(const Workers& workers, std::shared_ptr<web::TipSlots> slots, bool afm,
           surface::HeightGrid unmarked)
      : workers_(workers), slots_(std::move(slots)), afm_(afm), unmarked_(std::move(unmarked)) {}
  std::string next();
  /// The sample of the tip that next() has shown first; it stays when the session is over, until another's.
  surface::HeightGrid heights() const;

 private:
  struct Seen {
    std::uint64_t count = 0;
    int quiet = 1000;  ///< pictures since it moved
  };
  const Workers& workers_;
  std::shared_ptr<web::TipSlots> slots_;
  void look_at(std::shared_ptr<const surface::HeightView> view);

  bool afm_;
  surface::HeightGrid unmarked_;
  std::shared_ptr<const surface::HeightView> shown_;
  std::uint64_t shown_version_ = 0;
  std::uint64_t changes_ = 0;
  std::array<Seen, web::TipSlots::kSlots> seen_{};
};

}  // namespace telenano::app

#pragma once

#include <memory>
#include <stop_token>
#include <thread>

#include "telenano/nve_server/physics/surface/scan_fields.h"

namespace telenano::scene {

/// A thread that makes the fields of a large scan ahead of those who move over it (scan_fields.h), as long as
/// it lives. It hears no signals.
class TilesAhead {
 public:
  explicit TilesAhead(std::shared_ptr<const physics::ScanFields> fields);

  const physics::ScanFields& fields() const noexcept { return *fields_; }

 private:
  void run(const std::stop_token& stop) const;

  std::shared_ptr<const physics::ScanFields> fields_;
  std::jthread thread_;
};

}  // namespace telenano::scene

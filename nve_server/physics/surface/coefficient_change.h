#pragma once

#include <cstddef>

#include "telenano/nve_server/physics/surface/scan_fields.h"

namespace telenano::physics {

/// While one coefficient changes: the digest goes with it.
class ScanFields::Grid::Changing {
 public:
  Changing(Grid& grid, std::size_t number) noexcept : grid_(grid), number_(number) {
    grid_.digest -= grid_.words[number_];
  }
  ~Changing() {
    grid_.words[number_] = grid_.word(number_);
    grid_.digest += grid_.words[number_];
  }
  Changing(const Changing&) = delete;
  Changing& operator=(const Changing&) = delete;

 private:
  Grid& grid_;
  std::size_t number_;
};

}  // namespace telenano::physics

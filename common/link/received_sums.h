#pragma once

#include <algorithm>
#include <utility>

#include "telenano/common/base/vec3.h"
#include "telenano/common/link/messages.h"
#include "telenano/common/link/received_energy.h"

namespace telenano::link {

/// The slave's cumulative sums as known here, and what each accepted reply adds to them. Sums, so that a lost
/// reply's share comes with the next one; within an epoch they never fall, and what would fall adds nothing.
class ReceivedSums {
 public:
  struct News {
    double energy_in_aj = 0;
    double energy_out_aj = 0;
    double energy_sent_aj = 0;
    double wave_aj = 0;
    Vec3 wave = Vec3::Zero();
  };

  void reset() noexcept { *this = {}; }  ///< with the epoch
  /// The next reply's sums are where counting begins: they hold what was before our time.
  void begin_with_next() noexcept { begins_ = true; }

  News update(const Reply& reply) noexcept {
    const ReceivedEnergy port = port_, sent = sent_;
    port_.update(reply.energy_in_aj, reply.energy_out_aj);
    sent_.update(reply.port.energy_sent_aj, reply.port.wave_energy_aj);
    News news{port_.in() - port.in(), port_.out() - port.out(), sent_.in() - sent.in(),
              sent_.out() - sent.out(), reply.port.wave_sum - wave_sum_};
    wave_sum_ = reply.port.wave_sum;
    return std::exchange(begins_, false) ? News{} : news;
  }

 private:
  ReceivedEnergy port_;
  ReceivedEnergy sent_;  // energy and wave energy
  Vec3 wave_sum_ = Vec3::Zero();
  bool begins_ = false;
};

}  // namespace telenano::link

#include "telenano/nve_server/slave/nve_slave.h"
#include "telenano/nve_server/slave/state_fields.h"

namespace telenano::slave {

template <class Visit, class Of>
void NveSlave::visit_port(Visit& visit, Of& port) const noexcept {
  fields(visit, port.commanded_w_nm);
  fields(visit, port.extension_w_nm);
  if (scene_->potential) {
    fields(visit, port.potential);
  } else {
    // A level sample's two ports find the one table's handover each for itself, with the same result.
    const bool one_table = scalar_ && port.level.law.cache.tabulated;
    bool of_one_radius = one_table;
    visit(of_one_radius);
    law_fields(visit, port.level.law, of_one_radius);
    if (!scalar_) fields(visit, port.level);
  }
  fields(visit, port.solution);
  fields(visit, port.mode);
  visit(port.stored_aj);
}

template <class Visit>
void NveSlave::write_state(Visit& visit) const noexcept {
  sample_.write(visit);
  visit_port(visit, port());
  visit(energy_in_aj_);
  visit(energy_out_aj_);
  visit(paid_ahead_aj_);
  visit(std::uint64_t{last_faults_});
}

std::uint64_t NveSlave::state_hash() const noexcept {
  StateHash hash;
  write_state(hash);
  return hash.value();
}

std::size_t NveSlave::save(std::span<std::uint8_t> out) const noexcept {
  StateWriter writer(out);
  write_state(writer);
  return writer.ok() ? writer.size() : 0;
}

std::size_t NveSlave::snapshot_bytes_max() const noexcept {
  return kSnapshotBytes + sample_.mark_bytes_max();
}

bool NveSlave::load(std::span<const std::uint8_t> bytes) noexcept {
  StateReader reader(bytes);
  bool good = sample_.read(reader);
  Port& to = ports_[now_];
  to = {};
  visit_port(reader, to);
  reader(energy_in_aj_);
  reader(energy_out_aj_);
  reader(paid_ahead_aj_);
  std::uint64_t faults = 0;
  reader(faults);
  last_faults_ = static_cast<std::uint32_t>(faults);
  good = good && faults <= UINT32_MAX && reader.ok() && reader.at_end() && energy_in_aj_ >= 0 &&
         energy_out_aj_ >= 0;
  if (good) {
    scene_->law().derive(to.level.law.cache);
    ports_[1 - now_] = to;
    return true;
  }
  if (bytes.data() != at_first_.data()) reset();
  return false;
}

void NveSlave::reset() noexcept {
  if (at_first_.empty() || !load(at_first_)) sample_.reset();
}

}  // namespace telenano::slave

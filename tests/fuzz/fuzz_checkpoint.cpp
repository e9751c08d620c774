// Any bytes as a checkpoint, with the sum round it and without: changes to a true one, or anybody's. What is not
// whole, or not of this scene, is none; what is taken up is written again with the same hash, and what it then does
// is finite and within the slave's own limits.
#include <array>
#include <cmath>
#include <memory>
#include <vector>

#include "fuzz_input.h"
#include "telenano/nve_server/scene/scene.h"
#include "telenano/nve_server/server/checkpoint.h"
#include "telenano/nve_server/slave/nve_slave.h"

namespace {

using namespace telenano;
using fuzz::Script;

constexpr const char* kScene = R"(
name = "fuzzed"
[sample]
name = "PMMA"
youngs_modulus_gpa = 3.0
poisson_ratio = 0.37
surface_energy_j_m2 = 0.04
[surface]
kind = "flat"
[probe]
tip_radius_nm = 20.0
stiffness_n_m = 40.0
[probe.tip]
name = "silicon"
youngs_modulus_gpa = 160.0
poisson_ratio = 0.27
surface_energy_j_m2 = 0.2
[coupling]
stiffness_n_m = 20.0
[limits]
force_max_nn = 500.0
half_width_nm = 40.0
[start]
x_nm = 0.0
y_nm = 0.0
height_nm = 10.0
)";
constexpr server::CheckpointOf kOf{0x1234, 0x5678};

struct Base {
  std::shared_ptr<const scene::Scene> scene = scene::parse_scene(kScene, "fuzzed.toml");
  std::vector<std::uint8_t> payload;
  std::uint64_t hash = 0;
};

std::vector<std::uint8_t> written(const server::SessionState& state) {
  std::vector<std::uint8_t> bytes(server::kCheckpointBytes + state.tip.slave->snapshot_bytes_max());
  bytes.resize(server::write_checkpoint(kOf, state.session, state.tip, state.record, bytes));
  return bytes;
}

void press(slave::Slave& slave, slave::SlaveOutput& output) {
  for (int i = 1; i <= 60; ++i) {
    slave::SlaveInput input;
    input.follow = input.wanted = true;
    input.tip_target_pos_w_nm = slave.limits().start_pos_w_nm + Vec3(0.1 * i, 0, -0.25 * i);
    slave.step(input, 1e-3, output);
    FUZZ_CHECK(is_finite(output.force_w_nn) && is_finite(output.tip_pos_w_nm));
    FUZZ_CHECK(std::isfinite(output.energy_in_aj) && std::isfinite(output.energy_out_aj));
    FUZZ_CHECK(output.force_w_nn.norm() <= 1.01 * slave.limits().force_max_nn);
  }
}

const Base& base() {
  static const Base the = [] {
    Base b;
    server::SessionState state;
    state.session.resume_token = 5;
    state.session.owner = 9;
    state.session.epoch = 77;
    state.session.rate_hz = 1000;
    state.tip.slave = std::make_unique<slave::NveSlave>(b.scene);
    press(*state.tip.slave, state.tip.output);
    b.hash = state.tip.slave->state_hash();
    b.payload = written(state);
    return b;
  }();
  return the;
}

std::vector<std::uint8_t> sealed(const std::vector<std::uint8_t>& payload) {
  std::array<std::uint8_t, 40> before{};
  std::array<std::uint8_t, 8> after{};
  server::seal({1000, 3}, payload, before, after);
  std::vector<std::uint8_t> file(before.begin(), before.end());
  file.insert(file.end(), payload.begin(), payload.end());
  file.insert(file.end(), after.begin(), after.end());
  return file;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Script script(data, size);
  const std::uint8_t how = script.byte();
  const bool whole_file = (how & 1) != 0;
  std::vector<std::uint8_t> bytes = whole_file ? sealed(base().payload) : base().payload;
  const std::vector<std::uint8_t> unchanged = bytes;
  if ((how & 2) != 0) {
    const auto rest = script.take(size);
    bytes.assign(rest.begin(), rest.end());
  } else {
    const int changes = how >> 3;
    for (int i = 0; i < changes && !script.done(); ++i) bytes[script.word() % bytes.size()] = script.byte();
    if ((how & 4) != 0) bytes.resize(script.word() % (bytes.size() + 1));
  }
  std::span<const std::uint8_t> payload = bytes;
  if (whole_file) {
    server::CheckpointEnvelope envelope;
    payload = server::unseal(bytes, envelope);
    if (payload.empty()) {
      FUZZ_CHECK(bytes != unchanged);
      return 0;
    }
    FUZZ_CHECK(payload.size() + server::kEnvelopeBytes == bytes.size());
  }
  server::CheckpointHead head;
  const bool has_head = server::read_checkpoint_head(payload, head);
  const auto state = server::read_checkpoint(kOf, payload, std::make_unique<slave::NveSlave>(base().scene));
  if (!state) {
    FUZZ_CHECK(bytes != unchanged);
    return 0;
  }
  FUZZ_CHECK(has_head && head.token == state->session.resume_token && head.owner == state->session.owner);
  if (bytes == unchanged) FUZZ_CHECK(state->tip.slave->state_hash() == base().hash);
  const auto again = written(*state);
  const auto other = server::read_checkpoint(kOf, again, std::make_unique<slave::NveSlave>(base().scene));
  FUZZ_CHECK(other && other->tip.slave->state_hash() == state->tip.slave->state_hash());
  press(*state->tip.slave, state->tip.output);
  return 0;
}

// Any bytes as a slave's state: changes to a true one, whole, in pieces in any order, or bytes of anybody's.
// What is taken up is a state: it is written again with the same hash, and what it then does is finite and
// within the slave's own limits. What is not leaves a slave as a new one.
#include <cmath>
#include <memory>
#include <vector>

#include "fuzz_input.h"
#include "telenano/common/link/snapshot.h"
#include "telenano/nve_server/scene/scene.h"
#include "telenano/nve_server/slave/nve_slave.h"

namespace {

using namespace telenano;
using fuzz::Script;

constexpr const char* kSample = R"(
[sample]
name = "PMMA"
youngs_modulus_gpa = 3.0
poisson_ratio = 0.37
surface_energy_j_m2 = 0.04
)";
constexpr const char* kRest = R"(
[surface]
kind = "flat"
[friction]
shear_strength_mpa = 50.0
[probe]
tip_radius_nm = 20.0
stiffness_n_m = 40.0
lateral_stiffness_n_m = 100.0
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
constexpr const char* kMarks = "hardness_gpa = 0.25\n[marks]\nspacing_nm = 4.0\n";
constexpr const char* kParticle = R"(
[particle]
radius_nm = 15.0
x_nm = 30.0
y_nm = 0.0
[particle.material]
name = "polystyrene"
youngs_modulus_gpa = 2.0
poisson_ratio = 0.4
surface_energy_j_m2 = 0.066
[particle.friction]
sample_shear_strength_mpa = 30.0
tip_shear_strength_mpa = 30.0
rolling_length_nm = 0.3
)";

struct Base {
  std::shared_ptr<const scene::Scene> scene;
  std::vector<std::uint8_t> state;  ///< of a slave that has touched
  std::uint64_t hash = 0;
};

void touch(slave::NveSlave& slave, const Vec3& start_w_nm, double down_nm, double along_nm, int steps) {
  slave::SlaveOutput output;
  for (int i = 1; i <= steps; ++i) {
    slave::SlaveInput input;
    input.follow = input.wanted = true;
    const double part = static_cast<double>(i) / steps;
    input.tip_target_pos_w_nm = start_w_nm + Vec3(along_nm * part, 0, -down_nm * part);
    slave.step(input, 1e-3, output);
    FUZZ_CHECK(is_finite(output.force_w_nn) && is_finite(output.tip_pos_w_nm));
    FUZZ_CHECK(std::isfinite(output.energy_in_aj) && std::isfinite(output.energy_out_aj));
    FUZZ_CHECK(output.force_w_nn.norm() <= 1.01 * slave.limits().force_max_nn);
  }
}

const Base& base_of(std::uint8_t which) {
  static const std::vector<Base> bases = [] {
    std::vector<Base> all;
    for (const std::string& more : {std::string(), std::string(kMarks), std::string(kParticle)}) {
      Base base;
      base.scene =
          scene::parse_scene("name = \"fuzzed\"\n" + std::string(kSample) + more + kRest, "fuzzed.toml");
      slave::NveSlave slave(base.scene);
      touch(slave, slave.limits().start_pos_w_nm, 14, 5, 200);
      base.state.resize(slave.snapshot_bytes_max());
      base.state.resize(slave.save(base.state));
      base.hash = slave.state_hash();
      all.push_back(std::move(base));
    }
    return all;
  }();
  return bases[which % bases.size()];
}

/// What a server may send of it: each piece as it is, again, or of another state.
std::vector<std::uint8_t> fetched(const std::vector<std::uint8_t>& state, Script& script) {
  link::SnapshotFetch fetch(state.size() + 64);
  fetch.start();
  link::FrozenState frozen;
  frozen.bytes = state;
  frozen.size = state.size();
  std::int64_t now_ns = 0;
  for (int i = 0; i < 4096 && !fetch.complete() && fetch.active(); ++i) {
    link::SnapshotRequest request;
    if (!fetch.next(now_ns, 1'000'000, request)) {
      now_ns += 2'000'000;
      continue;
    }
    frozen.id = request.snapshot;
    link::SnapshotPiece piece;
    if (!frozen.piece(request.piece, piece)) continue;
    const std::uint8_t spoil = script.byte();
    if (spoil > 200) {
      piece.total = static_cast<std::uint32_t>(script.number(4));
      piece.piece = static_cast<std::uint32_t>(script.number(4));
      piece.size =
          std::min<std::uint32_t>(static_cast<std::uint32_t>(script.byte()), link::kSnapshotPieceBytes);
    } else if (spoil > 150) {
      piece.step += spoil;
    }
    fetch.take(piece);
  }
  if (!fetch.complete()) return {};
  FUZZ_CHECK(fetch.data().size() <= state.size() + 64);
  return {fetch.data().begin(), fetch.data().end()};
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Script script(data, size);
  const Base& base = base_of(script.byte());
  const std::uint8_t how = script.byte();
  std::vector<std::uint8_t> state = base.state;
  if (how % 4 == 1) {
    const auto rest = script.take(size);
    state.assign(rest.begin(), rest.end());
  } else if (how % 4 == 2) {
    state = fetched(state, script);
  } else {
    const int changes = how >> 2;
    for (int i = 0; i < changes && !script.done() && !state.empty(); ++i)
      state[script.word() % state.size()] = script.byte();
    if (how % 4 == 3) state.resize(script.word() % (state.size() + 1));
  }
  slave::NveSlave slave(base.scene);
  const std::uint64_t new_hash = slave.state_hash();
  if (!slave.load(state)) {
    FUZZ_CHECK(slave.state_hash() == new_hash);
    return 0;
  }
  if (state == base.state) FUZZ_CHECK(slave.state_hash() == base.hash);
  std::vector<std::uint8_t> again(slave.snapshot_bytes_max());
  again.resize(slave.save(again));
  slave::NveSlave other(base.scene);
  FUZZ_CHECK(other.load(again));
  FUZZ_CHECK(other.state_hash() == slave.state_hash());
  touch(slave, slave.limits().start_pos_w_nm, 12, 10, 30);
  return 0;
}

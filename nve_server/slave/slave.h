#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "telenano/common/base/vec3.h"
#include "telenano/common/link/messages.h"

namespace telenano::surface {
class HeightView;  // passed on to who draws; no slave looks into it
}

namespace telenano::slave {

/// What the slave's port is told, once per accepted command.
struct SlaveInput {
  Vec3 tip_target_pos_w_nm = Vec3::Zero();  ///< commanded end of the virtual coupling
  Vec3 tip_target_vel_w_nm_s = Vec3::Zero();
  bool follow = true;         ///< false: hold the present commanded position (clutch open, deadman released)
  bool wants_model = false;   ///< fill SlaveOutput::model
  bool retract = false;       ///< withdraw to a safe height whatever is commanded
  std::uint64_t opening = 0;  ///< which session it is that commands; 0: the server itself, or not known
  bool by_operator = false;  ///< the retract is a stop that the station sends, not the server's own (silence)
  /// The operator wants to engage: follow, or would if the tip were where the station believes. What a slave
  /// with its tip up waits for, if bringing it back takes more than a step.
  bool wanted = false;
  /// Work (SlaveOutput::work) after which the rest of the way is left for later steps. Only the first piece
  /// of the way is made whatever it takes.
  std::uint32_t work_most = UINT32_MAX;
};

/// What became of the wish to take back the last stroke of marks.
enum class UndoResult : std::uint8_t {
  kDone,
  kTouches,   ///< the tip touches, or would: lift it first
  kNothing,   ///< there is no stroke to take back, or it is too long ago, or too large
  kAnothers,  ///< the last stroke is not of who asks
};

/// SlaveOutput::measurement_age_ns of a slave that measures, but has not measured yet.
inline constexpr std::int64_t kNeverMeasuredNs = INT64_MAX;

struct SlaveOutput {
  Vec3 force_w_nn = Vec3::Zero();    ///< on the tip, through the coupling
  Vec3 tip_pos_w_nm = Vec3::Zero();  ///< apex
  /// Commanded end that the slave holds: behind the target where speed, workspace or force held it back, and
  /// away from it in a retract. Who resumes here feels no step.
  Vec3 commanded_pos_w_nm = Vec3::Zero();
  double deflection_nm = 0;  ///< up positive
  link::ContactState contact_state = link::ContactState::kFree;
  std::uint32_t fault_bits = 0;
  double energy_in_aj = 0;              ///< cumulative, monotone
  double energy_out_aj = 0;             ///< cumulative, monotone
  std::int64_t measurement_age_ns = 0;  ///< 0: computed, not measured; kNeverMeasuredNs: not yet
  /// What the port is like here, if asked for and known; version 0 = unknown.
  link::LocalModel model;
  link::Particle particle;  ///< where SlaveLimits::has_particle; a slave without one leaves it alone
  /// What this step took: iterations of the solvers, and one for each balance. A count, so that the same
  /// steps cost the same everywhere; one is a microsecond or two. 0 where nothing is computed.
  std::uint32_t work = 0;
};

/// What a station may know of a slave before it moves; all of it goes into Welcome, `has_particle` as a
/// feature, `well_aj` behind one; but `measures`, which the age of each reply tells.
struct SlaveLimits {
  Vec3 workspace_min_w_nm = Vec3::Zero();
  Vec3 workspace_max_w_nm = Vec3::Zero();
  Vec3 start_pos_w_nm = Vec3::Zero();
  double surface_z_w_nm = 0;
  double force_max_nn = 0;
  double coupling_stiffness_n_m = 0;
  double coupling_damping_n_s_m = 0;
  std::uint32_t rate_max_hz = 8000;
  bool has_particle = false;
  /// The deepest adhesive well of the scene: most that the sample can give out of its own, beyond what was
  /// ever put in (energy_out_aj − energy_in_aj). An upper bound; 0: none, or not known.
  double well_aj = 0;
  /// Balances a second that this slave makes besides one a step, whatever moves (a mode of the probe): 0 to
  /// some 10⁵.
  double balances_per_s = 0;
  bool keeps_marks = false;  ///< and can take back the last strokes of them
  bool measures = false;     ///< forces are an instrument's readings, which grow old; a model's do not
};

/// Seam: whatever touches the sample: the nanoscale virtual environment, or a real AFM.
class Slave {
 public:
  virtual ~Slave() = default;
  /// Moves the port by one command, `dt_s` after the last. Never throws, waits or allocates; an output with a
  /// fault bit is still safe to render.
  virtual void step(const SlaveInput& input, double dt_s, SlaveOutput& output) noexcept = 0;
  virtual const SlaveLimits& limits() const noexcept = 0;

  // A slave whose state is a function of its steps can be run twice, here and at the station: it says what
  // its state is, and gives it away. An instrument cannot: it has no state hash, so that no step log is
  // granted.

  /// 64 bits over all that later steps depend on; 0: its state is not known.
  virtual std::uint64_t state_hash() const noexcept { return 0; }
  /// The state as bytes; 0: there is none, or it does not fit.
  virtual std::size_t save(std::span<std::uint8_t> /*out*/) const noexcept { return 0; }
  virtual bool load(std::span<const std::uint8_t> /*bytes*/) noexcept { return false; }
  virtual void reset() noexcept {}
  /// What the last step said, or the one before a load(); without a local model. False: it does not know.
  virtual bool say_again(SlaveOutput& /*output*/) noexcept { return false; }
  virtual std::size_t snapshot_bytes_max() const noexcept { return 0; }
  /// The sample as it was before the last stroke of marks, from touching to parting; the tip stays where it is, and
  /// nobody is given energy for it. `of`: only if that stroke was made by this session (SlaveInput::opening);
  /// 0: whoever made it. `output` as if a step had been made without moving. Else nothing has changed.
  /// Never throws, waits or allocates.
  virtual UndoResult undo_marks(std::uint64_t /*of*/, SlaveOutput& /*output*/) noexcept {
    return UndoResult::kNothing;
  }
  /// The sample's heights as steps leave them, for threads that only look; null: no marks stay in it.
  virtual std::shared_ptr<const surface::HeightView> heights() const { return nullptr; }
};

}  // namespace telenano::slave

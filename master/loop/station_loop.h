#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "telenano/common/link/client_session.h"
#include "telenano/common/net/datagram.h"
#include "telenano/common/recording/datagram_row.h"
#include "telenano/common/recording/sample.h"
#include "telenano/common/recording/state_piece_row.h"
#include "telenano/common/rt/clock.h"
#include "telenano/master/device/haptic_device.h"
#include "telenano/master/loop/link_options.h"
#include "telenano/master/loop/scene_pipe.h"
#include "telenano/master/loop/undo_wish.h"
#include "telenano/master/station/station.h"

namespace telenano::loop {

/// The body of the station's loop: one tick of device, session and station. It sees only seams (HapticDevice,
/// Datagram) and is told the time, so the same object runs under a real-time timer and in virtual time over a
/// simulated link.
///
/// A tick, in this order:
///   receive every waiting datagram (a bounded number) → read the hand → play out the reply that is due →
///   Station::step → write the force → send handshake or command.
/// A command sent in tick k is answered before tick k+1 if the link is fast: one sample of delay, which
/// planning counts. Nothing allocates, waits or throws.
class StationLoop {
 public:
  /// With `clock`, datagrams are stamped with the moment at which they are sent and looked at, so that round
  /// trips do not contain the work of a tick; without (virtual time), with the tick's own time.
  StationLoop(device::HapticDevice& device, net::Datagram& socket, const net::Address& server,
              link::ClientSession& session, station::Station& station, const rt::Clock* clock = nullptr,
              const LinkOptions& options = {});

  /// `dt_s` since the last tick. Fills `sample` (timing fields of the loop's owner excepted). The sample's
  /// applied force acts from this tick to the next.
  void tick(std::int64_t now_ns, double dt_s, recording::Sample& sample) noexcept;

  /// Sends Bye, three times since nobody answers it.
  void say_bye(link::ByeReason reason) noexcept;

  /// Who fetches the server's scene; before the first tick, must outlive this. Null: nobody.
  void set_scene_pipe(ScenePipe* pipe) noexcept { scene_pipe_ = pipe; }
  /// That scene, which was asked for, is another one's to begin in: with its Welcome there is no session for this
  /// station any more. 0: none.
  void leave_for_scene(std::uint64_t scene_hash) noexcept { leaves_for_scene_ = scene_hash; }
  /// What comes is recorded from now on: an adapting deadband for replies is none, so that the forces in the recording
  /// are the slave's own and have no steps in them. One that a person has asked for stays.
  void set_records() noexcept { records_ = true; }
  /// For a replay, before a tick: a command goes in exactly those ticks in which one went.
  void send_as_recorded(bool sends) noexcept { sends_ = sends ? Sends::kNow : Sends::kNot; }
  void set_buttons(std::uint32_t buttons) noexcept { extra_buttons_ = buttons; }  ///< or-ed to the device's
  /// link::kFlagTakeOver: ask for a shared tip; link::kFlagHandOver: leave it to others; 0: as it comes.
  void set_tip_wish(std::uint32_t flags) noexcept { tip_wish_ = flags; }
  /// Asks to take the last stroke of marks back. False: the server cannot, or the last wish is not over yet.
  bool undo_marks(std::int64_t now_ns) noexcept;
  UndoAnswer undo_answer() const noexcept { return undo_.answer(); }
  const station::StationTrace& trace() const noexcept { return output_.trace; }
  /// The slave's step of the tick that was last, where steps are logged.
  const link::LoggedStep& step() const noexcept { return output_.step; }
  /// Why the device showed no force in the last tick.
  device::ForceOffCause force_off() const noexcept { return reading_.cause; }
  std::uint64_t send_failures() const noexcept { return send_failures_; }
  const link::Playout& playout() const noexcept { return playout_; }
  const link::SendGate& gate() const noexcept { return gate_; }
  const link::RateControl& rate() const noexcept { return rate_; }
  /// In the newest command that was sent; zero also where the session has none.
  const link::ReplyDeadband& told_reply_deadband() const noexcept { return told_reply_deadband_; }
  /// Of the tick that was last.
  const link::LinkQuality& quality() const noexcept { return quality_; }
  /// What came in the tick that was last, for the recording.
  std::span<const recording::DatagramRow> datagrams() const noexcept {
    return std::span(datagrams_).first(datagram_count_);
  }
  /// Of the server's state, likewise.
  std::span<const recording::StatePieceRow> state_pieces() const noexcept {
    return std::span(state_pieces_).first(state_piece_count_);
  }

 private:
  // Enough for what gathers in a quarter of a second at 1 kHz; the rest of a flood waits for the next tick.
  static constexpr std::size_t kDatagramsPerTick = 256;

  void fetch_snapshot(std::int64_t now_ns) noexcept;
  bool waits_for_scene(std::int64_t now_ns) noexcept;
  bool carries_steps() const noexcept;
  bool wants_to_send(std::int64_t now_ns) noexcept;
  link::ReplyDeadband reply_deadband() const noexcept;
  double hand_interval_s(double dt_s) noexcept;
  void send(std::size_t size) noexcept;
  void on_event(link::ClientEvent event, std::int64_t came_ns) noexcept;
  void note_datagram(std::int64_t came_ns) noexcept;
  void note_state_piece(const link::SnapshotPiece& piece) noexcept;
  const link::Reply* next_reply(std::int64_t now_ns, bool replied) noexcept;
  void fill(std::int64_t now_ns, const Vec3& applied_h_n, recording::Sample& sample) noexcept;

  device::HapticDevice& device_;
  net::Datagram& socket_;
  net::Address server_;
  link::ClientSession& session_;
  station::Station& station_;
  const rt::Clock* clock_;
  ScenePipe* scene_pipe_ = nullptr;
  device::DeviceReading reading_;
  link::Playout playout_;
  link::SendGate gate_;
  link::RateControl rate_;
  ReplyDeadbandConfig reply_deadband_;
  link::ReplyDeadband told_reply_deadband_;
  bool records_ = false;
  bool limits_rate_;
  enum class Sends : std::uint8_t { kAsDue, kNow, kNot };
  Sends sends_ = Sends::kAsDue;
  std::int64_t step_pace_ns_;
  std::int64_t paced_ns_ = 0;
  std::uint32_t paced_flags_ = 0;
  std::uint64_t rtt_samples_ = 0;
  std::uint32_t paced_method_ = 0;
  link::LinkQuality quality_;
  station::StationInput input_;
  UndoWish undo_;
  std::uint32_t tip_wish_ = 0;
  station::StationOutput output_;
  std::uint64_t sessions_begun_ = 0;
  std::uint64_t leaves_for_scene_ = 0;
  std::uint64_t asked_for_scene_in_ = 0;  // sessions() when it was asked for the station's own scene last
  std::uint32_t snapshot_of_ = 0;
  std::uint32_t extra_buttons_ = 0;
  std::int64_t ticks_ = 0;
  std::int64_t start_ns_ = 0;
  std::uint64_t send_failures_ = 0;
  std::array<recording::DatagramRow, kDatagramsPerTick> datagrams_{};
  std::size_t datagram_count_ = 0;
  std::array<recording::StatePieceRow, kDatagramsPerTick> state_pieces_{};
  std::size_t state_piece_count_ = 0;
  std::int64_t last_read_ns_ = 0;
  Vec3 applied_h_n_ = Vec3::Zero();
  /// One byte more than the largest datagram, so that an oversize one is seen as such.
  std::array<std::uint8_t, link::kMaxDatagramBytes + 1> buffer_{};
};

}  // namespace telenano::loop

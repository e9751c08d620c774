#pragma once

#include <cstdint>
#include <memory>

#include "telenano/common/link/reply_gate.h"
#include "telenano/common/link/session_table.h"
#include "telenano/common/link/snapshot.h"
#include "telenano/common/link/step_log.h"
#include "telenano/common/link/token_bucket.h"
#include "telenano/common/net/datagram.h"
#include "telenano/nve_server/server/port_account.h"
#include "telenano/nve_server/server/port_control.h"
#include "telenano/nve_server/server/tip_holder.h"
#include "telenano/nve_server/server/work_budget.h"
#include "telenano/nve_server/slave/slave.h"

namespace telenano::server {

/// A slave, and what it said last: a session's own, or the one that all share.
struct Tip {
  std::unique_ptr<slave::Slave> slave;
  slave::SlaveOutput output;
  std::int64_t last_step_ns = 0;
  Vec3 last_target_w_nm = Vec3::Zero();  ///< of the newest command
  std::int64_t moved_ns = 0;             ///< last command, or last change of its position on the way up
  bool at_rest = true;                   ///< withdrawn as far as it goes, or never moved
  std::size_t moved_by = TipHolder::kNobody;
};

/// What a session has besides its tip.
struct SessionRecord {
  /// Counts the sessions opened; one that is resumed keeps its number.
  std::uint64_t opening = 0;

  std::size_t scene = 0;  ///< which of the server's scenes its tip is in

  // For the audit.
  bool open = false;           ///< neither ended nor forgotten
  std::uint64_t identity = 0;  ///< of its newest Hello,
  net::Rights rights = net::Rights::kObserve;
  std::uint32_t audited_faults = 0;     ///< of the slave, since the last event
  std::int64_t audited_ns = INT64_MIN;  ///< when that was

  link::ReplyGate replies;  ///< which of them are left out
  PortControl control;
  PortAccount account;  ///< of a shared tip; a private one's is the slave's own
  net::Address address;
  link::FrozenState frozen;        ///< of the slave, while the station fetches it
  link::StepReceiver steps;        ///< where the session logs its steps; its ring is made with the session
  link::PortControl last_control;  ///< of the newest command: that of steps which come to their turn later
  bool undo_asked = false;         ///< by the newest command: link::kFlagUndo,
  std::uint32_t undo_faults = 0;   ///< and these say that nothing was taken back
  bool operates = true;            ///< the right of the newest command
  WorkBudget work;
  std::size_t party = 0;                    ///< place of its party's budget, if that is still there
  double behind_s = 0;                      ///< time of commands whose motion is left to later ones
  std::uint32_t command_flags = 0;          ///< of the newest command that was not superseded
  link::TokenBucket commands{0, 0};         ///< ServerConfig::rate_slack
  link::TokenBucket snapshot_pieces{0, 0};  ///< ServerConfig::snapshot_pieces_per_s
  link::TokenBucket scene_chunks{0, 0};     ///< how fast this session may fetch the scene
};

}  // namespace telenano::server

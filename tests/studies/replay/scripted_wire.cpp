#include "tests/studies/replay/scripted_wire.h"

#include <algorithm>

#include "telenano/common/link/messages.h"

namespace telenano::studies {
namespace {

using link::MessageType;
using link::StepReport;

// A reply may be overtaken, or come twice; one that did not come for so many commands never will.
constexpr std::size_t kRepliesKept = 1u << 16;
// More than any ring of steps.
constexpr std::uint64_t kStepsKept = 1u << 17;

Vec3 vec3(const std::array<double, 3>& v) {
  return {v[0], v[1], v[2]};
}

template <class Message>
std::vector<std::uint8_t> encoded(link::Codec& codec, const Message& message) {
  std::vector<std::uint8_t> bytes(link::kMaxDatagramBytes);
  bytes.resize(codec.encode(message, bytes));
  return bytes;
}

}  // namespace

/// The server has the steps up to `last`, or as many of them as are made.
void ScriptedWire::bring_up_to(std::uint64_t last, std::uint64_t session_id, std::int64_t now_ns) noexcept {
  link::StepBatch batch;
  std::uint32_t hold = 0;  // of a batch
  const auto bring = [&] {
    server_->bring_steps(session_id, batch, now_ns, hold);
    batch.count = 0;
  };
  for (; brought_ < last; ++brought_) {
    const auto found = made_.find(brought_ + 1);
    if (found == made_.end()) break;
    if (batch.count > 0 && found->second.hold != hold) bring();
    hold = found->second.hold;
    if (batch.count == 0) batch.first = brought_ + 1;
    batch.step[batch.count++] = found->second;
    if (batch.count == link::kMaxBatch) bring();
  }
  if (batch.count > 0) bring();
}

/// The last step that the slave may make by this command. If its reply was lost, nobody saw what it had made:
/// anything up to what the next reply that came says. After the last one, or a break, nothing is seen any more.
std::uint64_t ScriptedWire::executed_by(std::uint64_t command) const noexcept {
  const auto next = script_.told.lower_bound(command);
  const bool known = next != script_.told.end() && next->second.report.breaks == breaks_;
  return known ? std::max(next->second.report.executed, last_executed_) : last_executed_;
}

net::SendStatus ScriptedWire::send(std::span<const std::uint8_t> bytes, const net::Address&) noexcept {
  if (!open_ && !script_.told.empty()) {
    waits_for_steps_.push_back({clock_.now_ns(), {bytes.begin(), bytes.end()}});
  } else {
    deliver(bytes, clock_.now_ns());
  }
  return net::SendStatus::kSent;
}

void ScriptedWire::end_tick(std::uint64_t number, const link::LoggedStep& step) {
  if (number > brought_) made_[number] = step;
  while (made_.size() > kStepsKept) made_.erase(made_.begin());
  for (const auto& [at_ns, bytes] : waits_for_steps_) deliver(bytes, at_ns);
  waits_for_steps_.clear();
}

/// From here on the slave is not the recorded one.
void ScriptedWire::part(const StepReport& report) noexcept {
  if (!apart_) apart_since_ = tick_;
  apart_ = true;
  breaks_ = report.breaks;
}

/// The state that the station took up later was that of the slave by then, or before: it is so from here on.
bool ScriptedWire::take_up_state(std::uint64_t session_id, const StepReport& report) noexcept {
  if (states_ == nullptr) return false;
  for (const RecordedState& state : *states_) {
    if (state.tick < apart_since_ || state.breaks != report.breaks || state.step > report.executed) continue;
    StepReport log = report;
    log.executed = log.newest = state.step;
    log.state_hash = state.state_hash;
    const auto last = made_.find(state.step);
    const link::LoggedStep* const step = last != made_.end() ? &last->second : nullptr;
    if (!server_->take_up(session_id, state.bytes, log, step, others_.moved())) continue;
    others_.taken_up();
    last_executed_ = brought_ = state.step;
    taken_up_at_ = state.step;
    apart_ = false;
    return true;
  }
  return false;
}

void ScriptedWire::deliver(std::span<const std::uint8_t> bytes, std::int64_t now_ns) {
  std::uint64_t number = 0;
  std::array<std::uint8_t, link::kMaxDatagramBytes> rewritten{};
  const ToldLog* told = nullptr;
  bool took_up = false;
  if (!open_) {
    if (codec_.decode(bytes, incoming_) != link::DropCause::kNone || incoming_.type != MessageType::kCommand)
      return;
    number = incoming_.command.sequence;
    session_id_ = incoming_.command.session_id;
    if (!script_.order.commands.contains(number)) return;
    if (!script_.told.empty()) {
      const auto next = script_.told.lower_bound(number);
      if (next != script_.told.end() && next->first == number) told = &next->second;
      if (told != nullptr && (told->report.breaks != breaks_ || told->parts || told->observes))
        part(told->report);
      if (told != nullptr) others_.look(told->observes, told->report.state_hash);
      if (apart_ && told != nullptr && !told->parts && !told->observes) {
        server_->hold_tip(session_id_, now_ns);  // whose taking is a break, which the state has behind it
        took_up = take_up_state(session_id_, told->report);
      }
      const std::uint64_t most = apart_ ? last_executed_ : executed_by(number);
      bring_up_to(most, session_id_, now_ns);
      server_->set_steps_at_once(static_cast<std::size_t>(most - last_executed_));
      bytes = std::span<const std::uint8_t>(rewritten).first(
          codec_.encode(incoming_.command, std::span<const std::uint8_t>(), rewritten));
    }
  }
  std::vector<std::uint8_t> answer(link::kMaxDatagramBytes);
  const std::size_t size = server_->on_datagram(bytes, address_, now_ns, answer);
  if (size == 0) return;
  answer.resize(size);
  if (open_) {
    waiting_.push_back(std::move(answer));
    return;
  }
  ++steps_;
  if (!script_.told.empty() && !apart_) {
    const bool answers =
        codec_.decode(answer, incoming_) == link::DropCause::kNone && incoming_.type == MessageType::kReply;
    if (answers) last_executed_ = incoming_.reply.steps.executed;
    const bool other = told != nullptr && (!answers || last_executed_ != told->report.executed);
    if (other && other_steps_at_ == 0) other_steps_at_ = number;
  }
  // A state does not say what was said of the contact's plane before it: no reply does until the next step.
  const bool before_next_step = told != nullptr && taken_up_at_ == told->report.executed;
  const bool of_state = before_next_step || (took_up && script_.shares_tip);
  // Nor what this session had of a shared tip's account.
  if (took_up && script_.shares_tip)
    server_->set_account(session_id_, told->energy_in_aj, told->energy_out_aj);
  if (told != nullptr && (apart_ || of_state)) tells_.insert(number);
  replies_[number] = std::move(answer);
  if (replies_.size() > kRepliesKept) replies_.erase(replies_.begin());
}

void ScriptedWire::end_session(const StepReport& report, std::int64_t now_ns) {
  if (report.breaks != breaks_) part(report);
  if (apart_ || report.executed <= last_executed_) return;
  bring_up_to(report.executed, session_id_, now_ns);
  server_->make_steps(session_id_, static_cast<std::size_t>(report.executed - last_executed_), now_ns);
  last_executed_ = report.executed;
}

void ScriptedWire::use(server::Server& server) noexcept {
  server_ = &server;
  apart_ = false;
  others_.begin_slave();
  taken_up_at_.reset();
  breaks_ = 0;
  last_executed_ = brought_ = 0;
  made_.clear();
}

void ScriptedWire::begin_session(Script script, std::span<const std::uint8_t> answer,
                                 const StepReport& report) {
  next_script_ = std::move(script);
  welcome_.assign(answer.begin(), answer.end());
  if (codec_.decode(answer, incoming_) != link::DropCause::kNone || incoming_.type != MessageType::kWelcome)
    return;
  link::Welcome welcome = incoming_.welcome;
  session_id_ = welcome.session_id;
  if (!apart_ && (welcome.steps.executed != report.executed || welcome.steps.state_hash != report.state_hash))
    part(report);
  if (!apart_ || recorded_ == nullptr) return;
  welcome.steps = report;
  welcome.start_pos_w_nm = vec3(recorded_->tip_target_w_nm);  // the station's target of that tick
  welcome_ = encoded(codec_, welcome);
}

const std::vector<std::uint8_t>* ScriptedWire::reply_to(std::uint64_t command) const {
  const auto found = replies_.find(command);
  return found == replies_.end() ? nullptr : &found->second;
}

/// Of a tick's replies the station hears the newest one: what it says is in the recorded row.
std::vector<std::uint8_t> ScriptedWire::as_told(const std::vector<std::uint8_t>& reply,
                                                std::uint64_t command) {
  const auto told = script_.told.find(command);
  if (recorded_ == nullptr || told == script_.told.end() ||
      codec_.decode(reply, incoming_) != link::DropCause::kNone || incoming_.type != MessageType::kReply)
    return reply;
  link::Reply says = incoming_.reply;
  says.steps = told->second.report;
  says.force_w_nn = vec3(recorded_->force_w_nn);
  says.tip_pos_w_nm = vec3(recorded_->tip_pos_w_nm);
  says.deflection_nm = recorded_->deflection_nm;
  says.contact_state = static_cast<link::ContactState>(recorded_->contact_state);
  says.fault_bits = recorded_->fault_bits;
  says.energy_in_aj = recorded_->slave_energy_in_aj;
  says.energy_out_aj = recorded_->slave_energy_out_aj;
  if (says.model.version == 0 && recorded_->model_version != 0) says.model.normal_w = Vec3::UnitZ();
  says.model.version = recorded_->model_version;
  if (told->second.observes) says.tip.hold = 0;
  // Where the tip stood when it went to another hand: the station's target of that tick.
  if (!says.tip.empty() || told->second.observes) says.tip.pos_w_nm = vec3(recorded_->tip_target_w_nm);
  return encoded(codec_, says);
}

std::vector<std::uint8_t> ScriptedWire::next_piece() {
  if (pieces_.empty()) return {};
  const recording::StatePieceRow& row = pieces_.front();
  link::SnapshotPiece piece;
  piece.session_id = session_id_;
  piece.snapshot = row.snapshot;
  piece.piece = row.piece;
  piece.step = row.step;
  piece.state_hash = row.state_hash;
  piece.breaks = row.breaks;
  piece.total = row.total;
  piece.size = row.size;
  piece.data = row.data;
  pieces_ = pieces_.subspan(1);
  return encoded(codec_, piece);
}

bool ScriptedWire::receive(std::span<std::uint8_t> buffer, net::Received& received) noexcept {
  const auto give = [&](const std::vector<std::uint8_t>& bytes, std::int64_t age_ns) {
    std::copy_n(bytes.begin(), std::min(bytes.size(), buffer.size()), buffer.begin());
    received = {};
    received.size = bytes.size();
    received.from = address_;
    received.age_ns = age_ns;
    return true;
  };
  if (!waiting_.empty()) {
    const auto bytes = std::move(waiting_.front());
    waiting_.pop_front();
    return give(bytes, 0);
  }
  while (!rows_.empty()) {
    const recording::DatagramRow row = rows_.front();
    rows_ = rows_.subspan(1);
    const std::int64_t age_ns = clock_.now_ns() - row.came_ns;
    const bool accepted = row.drop == 0;
    switch (static_cast<MessageType>(row.type)) {
      case MessageType::kReply: {
        // Of a session before this one: nothing.
        if (row.drop == static_cast<std::uint32_t>(link::DropCause::kUnknownSession)) break;
        const auto* reply = reply_to(row.answers);
        if (reply == nullptr) break;
        if (!tells_.contains(row.answers)) return give(*reply, age_ns);
        told_in_tick_ = told_in_tick_ || accepted;
        return give(as_told(*reply, row.answers), age_ns);
      }
      case MessageType::kSnapshotPiece:
        if (accepted && !pieces_.empty()) return give(next_piece(), age_ns);
        break;
      case MessageType::kBye:
        if (accepted)
          return give(encoded(codec_, link::Bye{session_id_, static_cast<link::ByeReason>(row.break_reason)}),
                      age_ns);
        break;
      case MessageType::kWelcome:
        if (!accepted || welcome_.empty()) break;
        script_ = std::move(next_script_);
        replies_.clear();
        tells_.clear();
        waits_for_steps_.clear();
        told_in_tick_ = told_in_tick_ || apart_;
        return give(std::exchange(welcome_, {}), age_ns);
      default:
        break;
    }
  }
  return false;
}

}  // namespace telenano::studies

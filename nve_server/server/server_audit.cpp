// What the server tells an auditor (audit.h).
#include <utility>

#include "telenano/nve_server/server/server.h"

namespace telenano::server {
namespace {

// A fault that comes and goes with every step is one event in this time.
constexpr std::int64_t kFaultEventNs = 1'000'000'000;

}  // namespace

AuditEvent Server::audit_event(AuditEvent::Kind kind, std::size_t slot, std::int64_t now_ns) const noexcept {
  const SessionRecord& record = records_[slot];
  AuditEvent event;
  event.kind = kind;
  event.at_ns = now_ns;
  event.session = record.opening;
  event.identity = record.identity;
  event.rights = record.rights;
  event.address = record.address;
  return event;
}

void Server::audit(AuditEvent::Kind kind, std::size_t slot, std::int64_t now_ns,
                   std::uint32_t reason) noexcept {
  if (config_.audit == nullptr) return;
  AuditEvent event = audit_event(kind, slot, now_ns);
  event.reason = reason;
  config_.audit->push(event);
}

void Server::audit_refusal(link::RefuseReason reason, const net::Address& from, const net::Standing& standing,
                           std::int64_t now_ns) noexcept {
  if (config_.audit == nullptr) return;
  AuditEvent event;
  event.kind = AuditEvent::Kind::kRefused;
  event.at_ns = now_ns;
  event.identity = standing.identity;
  event.rights = standing.rights;
  event.address = from;
  event.reason = static_cast<std::uint32_t>(reason);
  config_.audit->push(event);
}

void Server::audit_faults(std::size_t slot, std::uint32_t faults, std::int64_t now_ns) noexcept {
  if (config_.audit == nullptr) return;
  SessionRecord& record = records_[slot];
  record.audited_faults |= faults & ~std::uint32_t{link::kFaultRetracted};  // withdrawing is no fault
  const bool waits = record.audited_ns != INT64_MIN && now_ns - record.audited_ns < kFaultEventNs;
  if (record.audited_faults == 0 || waits) return;
  AuditEvent event = audit_event(AuditEvent::Kind::kFault, slot, record.audited_ns = now_ns);
  event.faults = std::exchange(record.audited_faults, 0);
  config_.audit->push(event);
}

void Server::audit_holder(std::size_t before, std::int64_t now_ns) noexcept {
  const std::size_t now = holder_.holder();
  if (now == before) return;
  if (before != TipHolder::kNobody) audit(AuditEvent::Kind::kTipLeft, before, now_ns);
  if (now != TipHolder::kNobody) audit(AuditEvent::Kind::kTipTaken, now, now_ns);
}

}  // namespace telenano::server

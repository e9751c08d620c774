#include "telenano/nve_server/afm_sim/sim_server.h"

#include <poll.h>
#include <sys/stat.h>

#include <algorithm>
#include <cstdio>
#include <fstream>

#include "telenano/common/base/error.h"

namespace telenano::afm_sim {

using nanonis::FrameReader;

SimServer::SimServer(const SimServerOptions& options, const SimController& controller, const rt::Clock& clock)
    : options_(options), controller_(controller), clock_(clock), begin_ns_(clock.now_ns()) {
  for (const net::Address& address : options_.ports) ports_.emplace_back().listener.emplace(address);
  std::sort(options_.faults.begin(), options_.faults.end(),
            [](const Fault& a, const Fault& b) { return a.at_ns < b.at_ns; });
}

std::vector<net::Address> SimServer::local() const {
  std::vector<net::Address> all;
  for (const Port& port : ports_) all.push_back(port.listener->local());
  return all;
}

void SimServer::apply(const Fault& fault) {
  switch (fault.kind) {
    case FaultKind::kSilent:
      silent_until_ns_ = now_ns() + fault.length_ns;
      break;
    case FaultKind::kReset:
      for (Port& port : ports_) {
        port.stream.reset();
        forget_client(port);
      }
      break;
    case FaultKind::kGarbage:
      for (Port& port : ports_) port.garbage = true;
      break;
    case FaultKind::kSlow:
      slow_until_ns_ = now_ns() + fault.length_ns;
      slow_ns_ = fault.delay_ns;
      break;
    case FaultKind::kSensor:
      controller_.set_sensor_fault(fault.sensor);
      break;
    case FaultKind::kWithdraw:
      controller_.set_withdraw_fault(fault.withdraw, fault.count);
      break;
    case FaultKind::kDip:
      controller_.dip(fault.depth_nm, fault.length_ns);
      break;
  }
}

/// No client, the tip up, and no file to look at: only `stop` and whoever connects can end that, and who connects
/// wakes it.
bool SimServer::nobody_and_nothing() const noexcept {
  return options_.control_file.empty() && controller_.withdrawn() &&
         std::none_of(ports_.begin(), ports_.end(), [](const Port& port) { return port.stream.open(); });
}

void SimServer::look_at_control_file() {
  if (options_.control_file.empty() || now_ns() < control_looked_ns_ + kLookNs) return;
  control_looked_ns_ = now_ns();
  struct stat info {};
  if (::stat(options_.control_file.c_str(), &info) != 0) return;
  const std::int64_t stamp = info.st_mtim.tv_sec * std::int64_t{1'000'000'000} + info.st_mtim.tv_nsec;
  // Empty: somebody has opened it and not written yet, which may happen within one tick of the file's clock.
  if (stamp == control_stamp_ns_ || info.st_size == 0) return;
  control_stamp_ns_ = stamp;
  std::ifstream file(options_.control_file);
  for (std::string line; std::getline(file, line);) {
    if (line.empty()) continue;
    try {
      apply(parse_fault(line, options_.control_file));
      std::fprintf(stderr, "telenano-afm-sim: %s\n", line.c_str());
    } catch (const UserError& error) {
      std::fprintf(stderr, "telenano-afm-sim: %s\n", error.what());
    }
  }
}

/// Says, each time that the tip is up again, how hard it has pressed since it was up before.
void SimServer::look_at_tip() {
  const bool out = !controller_.withdrawn();
  if (out == tip_out_) return;
  tip_out_ = out;
  if (out) return;
  const double peak_nn = controller_.tip().peak_force_nn();
  std::fprintf(stderr, "telenano-afm-sim: the tip is up again; its greatest force was %.2f nN\n", peak_nn);
  greatest_nn_ = std::max(greatest_nn_, peak_nn);
  controller_.tip().forget_peak();
}

/// The client is gone, and with it what it was owed.
void SimServer::forget_client(Port& port) {
  port.stream.close();
  port.reader.clear();
  port.pending.reset();
  port.unknown.clear();
  port.out.clear();
}

/// Reads what has come; notices a client that has left.
void SimServer::hear(Port& port) {
  std::array<std::uint8_t, 4096> buffer;
  while (port.stream.open()) {
    std::size_t n = 0;
    const auto status = port.stream.read(buffer, n);
    if (status == net::TcpStream::Status::kClosed) return forget_client(port);
    if (status == net::TcpStream::Status::kWouldBlock) return;
    port.reader.feed(std::span(buffer).first(n));
  }
}

void SimServer::accept(Port& port) {
  for (;;) {
    net::TcpStream next = port.listener->accept();
    if (!next.open()) return;
    hear(port);                        // whoever closes and connects again has closed before
    if (port.stream.open()) continue;  // in use: the newcomer is closed at once
    forget_client(port);
    port.stream = std::move(next);
  }
}

void SimServer::answer(Port& port, std::int64_t now) {
  nanonis::Bytes bytes;
  if (!port.unknown.empty()) {
    // Whatever it returns if it is a command: the error alone can be read without knowing.
    const nanonis::Command none{nanonis::CommandId::kStop, port.unknown, "", ""};
    bytes = nanonis::encode_answer(none, {{}, {}, 1, "unknown command, or its body has another length"},
                                   nanonis::ErrorForm::kAlone);
    port.unknown.clear();
  } else {
    if (!controller_.finish(*port.pending, now)) return;
    bytes = nanonis::encode_answer(nanonis::command(port.pending->call.id), port.pending->answer,
                                   controller_.config().error_form);
    port.pending.reset();
  }
  if (port.garbage) {
    for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random_.bits());
    port.garbage = false;
  }
  if (port.wants_reply) port.out.insert(port.out.end(), bytes.begin(), bytes.end());
}

void SimServer::serve(Port& port, int index) {
  hear(port);
  if (!port.stream.open()) return;
  const std::int64_t now = now_ns();
  for (bool again = true; again;) {
    again = false;
    if (port.pending || !port.unknown.empty()) {
      answer(port, now);
      if (port.pending) break;
    }
    nanonis::Header header;
    std::span<const std::uint8_t> body;
    const auto status = port.reader.next(header, body);
    if (status == FrameReader::Status::kBroken) return forget_client(port);
    if (status == FrameReader::Status::kFrame) {
      ++calls_;
      port.wants_reply = header.wants_reply;
      const nanonis::Command* command = nanonis::find_command(header.name);
      nanonis::Call call;
      if (command == nullptr || !nanonis::decode_call(*command, body, call)) {
        port.unknown = header.name;
      } else {
        port.pending = controller_.begin(call, index, now);
        if (now < slow_until_ns_) port.pending->ready_ns += slow_ns_;
      }
      again = true;
    }
  }
  while (!port.out.empty()) {
    std::size_t n = 0;
    const auto status = port.stream.write(port.out, n);
    port.out.erase(port.out.begin(), port.out.begin() + static_cast<std::ptrdiff_t>(n));
    if (status == net::TcpStream::Status::kClosed) forget_client(port);
    if (status != net::TcpStream::Status::kOk) break;
  }
}

void SimServer::wait(std::int64_t most_ns) {
  std::vector<pollfd> entries;
  for (const Port& port : ports_) {
    entries.push_back({port.listener->handle(), POLLIN, 0});
    if (port.stream.open()) entries.push_back({port.stream.handle(), POLLIN, 0});
  }
  const timespec timeout{0, static_cast<long>(std::clamp<std::int64_t>(most_ns, 0, 999'999'999))};
  ::ppoll(entries.data(), entries.size(), &timeout, nullptr);
}

void SimServer::run(const std::atomic<bool>& stop) {
  while (!stop.load(std::memory_order_relaxed)) {
    std::int64_t now = now_ns();
    while (next_fault_ < options_.faults.size() && options_.faults[next_fault_].at_ns <= now)
      apply(options_.faults[next_fault_++]);
    look_at_control_file();
    controller_.advance_to(now);
    look_at_tip();
    if (now < silent_until_ns_) {
      // Deaf: what is sent waits in the sockets; the tip and its protection go on.
      const timespec nap{0, static_cast<long>(std::min<std::int64_t>(silent_until_ns_ - now, 1'000'000))};
      ::nanosleep(&nap, nullptr);
      continue;
    }
    // Who asks wakes it; what the tip does meanwhile is made up for then.
    std::int64_t next_ns = now + (nobody_and_nothing() ? kRestNs : kLookNs);
    if (next_fault_ < options_.faults.size()) next_ns = std::min(next_ns, options_.faults[next_fault_].at_ns);
    for (std::size_t i = 0; i < ports_.size(); ++i) {
      accept(ports_[i]);
      if (ports_[i].stream.open()) serve(ports_[i], static_cast<int>(i));
      if (ports_[i].pending) {
        const bool waits = ports_[i].pending->wait != SimController::Pending::Wait::kTime;
        next_ns = std::min(next_ns, std::max(ports_[i].pending->ready_ns, waits ? now + 500'000 : 0));
      }
    }
    wait(next_ns - now_ns());
  }
}

}  // namespace telenano::afm_sim

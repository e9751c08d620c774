#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "tests/studies/bench/result_rows.h"

namespace telenano::studies {

struct ServerBenchOptions {
  std::string flat;  ///< scene
  std::string scan;
  int server_cpu = 0;
  int client_cpu = 1;
  int rounds = 9;
  double round_s = 0.4;
  std::size_t sockets = 8;
  std::size_t sessions_each = 32;
  std::string only;  ///< one of the cases; empty: all
};

/// Exchanges for a second of one processor's time: the product's server in full use beside an echo by
/// recvmmsg and sendmmsg of the same bytes; with the scan beside an echo that spins for as long as the
/// scene's own step takes.
std::vector<BenchRow> run_capacity_bench(const ServerBenchOptions& options);

/// What the reply gate costs the server: processor time of an exchange without its socket, command in, reply out,
/// beside the same commands of a session that has not agreed on leaving replies out. Three sessions: one that asks for
/// every reply, one whose force changes by more than its deadband in each command, one whose force is always within.
std::vector<BenchRow> run_gate_bench(const ServerBenchOptions& options);

struct PacedOptions {
  std::string scene;
  std::size_t sessions = 200;
  std::size_t together = 10;  ///< stations that share a socket and send at once
  std::uint32_t rate_hz = 1000;
  double seconds = 60;
  int server_cpu = 0;
  int client_cpu = 1;
  int server_priority = 0;  ///< as serve --rt-priority

  std::size_t groups() const noexcept { return (sessions + together - 1) / together; }
  /// How many stations are in one of them.
  std::size_t in_group(std::size_t group, std::size_t groups) const noexcept {
    return sessions / groups + (group < sessions % groups ? 1 : 0);
  }
};

constexpr double kServiceTargetUs = 1000;  ///< of the 99th percentile

struct PacedResult {
  std::uint64_t commands = 0;
  std::uint64_t left_out = 0;  ///< that could not be sent within a period of their time
  std::uint64_t replies = 0;
  double p50_us = 0, p99_us = 0, p999_us = 0, max_us = 0;  ///< sent by the station … in its socket
  /// Of each whole second's own percentile: one long stop of the machine is in one of them.
  double median_second_p99_us = 0;
  std::size_t seconds = 0, seconds_that_hold = 0;
  double since_due_p99_us = 0;  ///< from when it was to be sent: what the stations are late is in it
  double late_p99_us = 0;       ///< of the sending: how far the stations keep their own times
  double sent_rate_hz = 0;
  double server_share = 0;  ///< of its processor
  double sent_part() const noexcept {
    return static_cast<double>(commands) /
           static_cast<double>(std::max<std::uint64_t>(commands + left_out, 1));
  }
  double answered_part() const noexcept {
    return static_cast<double>(replies) / static_cast<double>(std::max<std::uint64_t>(commands, 1));
  }
  bool keeps_time() const noexcept { return late_p99_us < 500 && sent_part() >= 0.99; }
  bool holds() const noexcept {
    return sent_part() >= 0.99 && answered_part() >= 0.999 && p99_us < kServiceTargetUs;
  }
};

/// Stations that send at a fixed rate, in groups that are evenly spread over the period.
PacedResult run_paced(const PacedOptions& options);

/// The floor: datagrams of the same sizes at the same times, answered by echo_batched. What this is late, the
/// machine is.
PacedResult run_paced_echo(const PacedOptions& options);

}  // namespace telenano::studies

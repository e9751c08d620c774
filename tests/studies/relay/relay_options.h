#pragma once

#include <cstdint>
#include <string>

#include "tests/studies/relay/relay.h"

namespace telenano::studies {

/// The command line of `telenano-lab relay` as it was written. Where a text may hold two numbers "A,B", A is
/// for the way to the server and B for the way back; one number is for both.
struct RelayOptions {
  std::string listen;
  std::string to;
  std::string delay_ms = "0";
  std::string jitter_ms = "0";
  std::string jitter = "uniform";
  bool any_order = false;
  std::string loss = "0";
  std::string burst = "1";
  std::string burst_ms = "0";
  std::string duplicate = "0";
  std::string reorder = "0";
  std::string reorder_ms = "2";
  std::string corrupt = "0";
  std::string truncate = "0";
  std::string rate_bit_s = "0";
  std::string queue_bytes = "65536";
  std::string drift_ppm = "0";
  std::string outage;
  std::string random_outage;
  std::string trace;
  std::uint64_t seed = 1;
  std::size_t max_clients = 64;
  double idle_s = 60;
  double duration_s = 0;  ///< 0: until a signal
  bool quiet = false;
  bool expose = false;  ///< may listen off loopback for a server on loopback
};

/// Throws UserError that names the flag, the value and what is expected.
RelayConfig relay_config(const RelayOptions& options);

}  // namespace telenano::studies

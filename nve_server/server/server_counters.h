#pragma once

#include <cstdint>

namespace telenano::server {

struct ServerCounters {
  std::uint64_t datagrams = 0;
  std::uint64_t exchanges = 0;  ///< commands accepted: answered, or
  std::uint64_t left_out = 0;   ///< within the deadband of their session
  std::uint64_t opened = 0;
  std::uint64_t resumed = 0;
  std::uint64_t timed_out = 0;
  std::uint64_t ended = 0;         ///< by Bye
  std::uint64_t holdings = 0;      ///< how often a shared tip went to somebody
  std::uint64_t recovered = 0;     ///< lost commands that a later datagram repeated
  std::uint64_t scene_chunks = 0;  ///< pieces of the scene sent
  std::uint64_t work = 0;          ///< slave::SlaveOutput::work, in all
  std::uint64_t deferred = 0;      ///< commands answered whose motion was left to later ones
  std::uint64_t undone = 0;        ///< strokes of marks taken back
  std::uint64_t switched = 0;      ///< sessions brought to another scene
  std::uint64_t cut = 0;           ///< steps that ended before their way did, for the same reason

  void add(const ServerCounters& more) noexcept {
    datagrams += more.datagrams;
    exchanges += more.exchanges;
    left_out += more.left_out;
    opened += more.opened;
    resumed += more.resumed;
    timed_out += more.timed_out;
    ended += more.ended;
    holdings += more.holdings;
    recovered += more.recovered;
    scene_chunks += more.scene_chunks;
    work += more.work;
    deferred += more.deferred;
    cut += more.cut;
    undone += more.undone;
    switched += more.switched;
  }
};

}  // namespace telenano::server

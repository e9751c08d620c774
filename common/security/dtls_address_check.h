#pragma once

// Only for the files of this folder.

#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "telenano/common/security/connection_id.h"

namespace telenano::security {

/// Whether a station hears what is sent to the address that its datagrams seem to come from. An association
/// that comes to another address has not shown that: until its station has answered a question from there, it is
/// sent no more than three times what came from there (RFC 9000, 8), so that a station that writes under a
/// false address is no amplifier.
class AddressCheck {
 public:
  bool proven() const noexcept { return proven_; }

  /// The association has come to another address.
  void begin(std::int64_t now_ns) noexcept;
  /// `bytes` have come from the new address. Returns what is to be asked there now, if anything.
  std::optional<AddressProof> heard(std::uint64_t bytes, std::int64_t now_ns) noexcept;
  /// May so many bytes be sent there now? If so, they are counted.
  bool may_send(std::uint64_t bytes) noexcept;

  /// Is this datagram an answer to such a question, and so not for the loop behind?
  static bool is_answer(std::span<const std::uint8_t> plain) noexcept;
  /// An answer has come from the new address: if it is the right one, the station is sent all.
  void take_answer(std::span<const std::uint8_t> plain) noexcept;

 private:
  bool proven_ = true;
  bool can_ask_ = false;  ///< without a random number nobody is asked, and the station is sent less
  std::uint64_t heard_bytes_ = 0;
  std::uint64_t told_bytes_ = 0;
  std::int64_t asked_ns_ = 0;
  std::array<std::uint8_t, 8> question_{};
};

}  // namespace telenano::security

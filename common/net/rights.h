#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>

namespace telenano::net {

/// What a peer may do, each with all before it. Kept with its key (common/security).
enum class Rights : std::uint8_t {
  kObserve,    ///< sessions whose commands do not move the tip
  kOperate,    ///< sessions that move it
  kAdminister  ///< and take over a shared tip at once
};

inline constexpr std::array<std::string_view, 3> kRightsNames = {"observe", "operate", "administer"};

constexpr std::string_view name(Rights rights) noexcept {
  return kRightsNames[static_cast<std::size_t>(rights)];
}

constexpr std::optional<Rights> parse_rights(std::string_view text) noexcept {
  for (std::size_t i = 0; i < kRightsNames.size(); ++i) {
    if (text == kRightsNames[i]) return static_cast<Rights>(i);
  }
  return std::nullopt;
}

/// What the channel that a datagram came through vouches for. Plain UDP proves no address and shows no key:
/// it is every local user's (loopback), who may operate unless who serves says otherwise.
struct Standing {
  bool address_proven = false;
  Rights rights = Rights::kOperate;
  /// Who: a number of the key or certificate, the same in every channel that it opens. 0: nobody has said.
  std::uint64_t identity = 0;
};

}  // namespace telenano::net

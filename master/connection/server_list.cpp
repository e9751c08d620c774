#include "telenano/master/connection/server_list.h"

#include <fmt/format.h>

#include <algorithm>

#include "telenano/common/base/error.h"

namespace telenano::connection {

std::vector<std::string> server_names(const std::string& list, const char* flag, const char* expected) {
  std::vector<std::string> names;
  for (std::size_t from = 0; from <= list.size();) {
    const std::size_t comma = std::min(list.find(',', from), list.size());
    names.push_back(list.substr(from, comma - from));
    if (names.back().empty())
      throw UserError(fmt::format("{} '{}': an entry is empty; give {}", flag, list, expected));
    from = comma + 1;
  }
  return names;
}

ServerList::ServerList(const ServerAccess& access) {
  for (const std::string& name : server_names(access.server)) {
    ServerAccess one = access;
    one.server = name;
    servers_.push_back(std::make_unique<Server>(one, net::parse_address(name, "--server")));
  }
}

bool ServerList::set_dscp(int dscp) noexcept {
  bool all = true;
  for (const auto& server : servers_) all = server->link.set_dscp(dscp) && all;
  return all;
}

void ServerList::practise(const link::PracticeLink& link) {
  for (const auto& server : servers_) server->link.practise(link);
}

net::SendStatus ServerList::send(std::span<const std::uint8_t> bytes, const net::Address&) noexcept {
  return link().datagram().send(bytes, address());
}

bool ServerList::receive(std::span<std::uint8_t> buffer, net::Received& received) noexcept {
  if (!link().datagram().receive(buffer, received)) return false;
  received.from = received.from == address() ? as() : net::Address{};  // somebody else's is nobody's
  return true;
}

}  // namespace telenano::connection

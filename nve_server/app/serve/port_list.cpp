#include "telenano/nve_server/app/serve/port_list.h"

#include <algorithm>
#include <charconv>

#include "telenano/common/base/error.h"

namespace telenano::app {
namespace {

constexpr std::size_t kPorts = 4;

[[noreturn]] void refuse(const std::string& text, const std::string& what, const std::string& why) {
  throw UserError(what + " '" + text + "': " + why +
                  "; expected four TCP ports (motion, reads, data, emergency), e.g. 6501-6504 or "
                  "6501-6503,6514");
}

std::uint16_t port_of(const std::string& word, const std::string& text, const std::string& what) {
  unsigned port = 0;
  const char* const end = word.data() + word.size();
  const auto parsed = std::from_chars(word.data(), end, port);
  if (word.empty() || parsed.ec != std::errc() || parsed.ptr != end || port > 65535)
    refuse(text, what, "'" + word + "' is not a port");
  return static_cast<std::uint16_t>(port);
}

}  // namespace

std::vector<std::uint16_t> parse_port_list(const std::string& text, const std::string& what) {
  std::vector<std::uint16_t> ports;
  for (std::size_t at = 0; at <= text.size();) {
    const std::size_t comma = std::min(text.find(',', at), text.size());
    const std::string part = text.substr(at, comma - at);
    const std::size_t dash = part.find('-');
    const unsigned first = port_of(part.substr(0, dash), text, what);
    const unsigned last = dash == std::string::npos ? first : port_of(part.substr(dash + 1), text, what);
    if (last < first) refuse(text, what, "the range is empty");
    if (last - first + 1 > kPorts)
      refuse(text, what, "these are " + std::to_string(last - first + 1) + " ports");
    for (unsigned port = first; port <= last; ++port) ports.push_back(static_cast<std::uint16_t>(port));
    at = comma + 1;
  }
  if (ports.size() != kPorts) refuse(text, what, "these are " + std::to_string(ports.size()) + " ports");
  for (std::size_t i = 0; i < ports.size(); ++i) {
    if (ports[i] != 0 && std::count(ports.begin(), ports.end(), ports[i]) > 1)
      refuse(text, what, "port " + std::to_string(ports[i]) + " has two roles");
  }
  return ports;
}

}  // namespace telenano::app

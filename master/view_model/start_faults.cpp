#include "telenano/master/view_model/start_faults.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <string_view>
#include <utility>
#include <vector>

namespace telenano::view_model {
namespace {

constexpr std::size_t kHostMost = 253;   // RFC 1035, 2.3.4, without the root's dot
constexpr std::size_t kPathMost = 4095;  // PATH_MAX of Linux, without the zero at the end
constexpr std::size_t kSceneMost = 255;
constexpr std::size_t kServerMost = 4095;
constexpr std::size_t kQuoted = 40;  // characters of what was typed that a line repeats

/// Bytes of the character of UTF-8 that stands there; 0: none does.
std::size_t character_bytes(std::string_view text, std::size_t at) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[at + i]); };
  const unsigned first = byte(0);
  const std::size_t count = first < 0x80             ? 1
                            : (first & 0xE0) == 0xC0 ? 2
                            : (first & 0xF0) == 0xE0 ? 3
                            : (first & 0xF8) == 0xF0 ? 4
                                                     : 0;
  if (count == 0 || at + count > text.size()) return 0;
  if (count == 1) return 1;
  unsigned code = first & (0x7Fu >> count);
  for (std::size_t i = 1; i < count; ++i) {
    if ((byte(i) & 0xC0) != 0x80) return 0;
    code = (code << 6) | (byte(i) & 0x3Fu);
  }
  // Neither longer than needed, nor half a pair of UTF-16, nor beyond the last one (RFC 3629).
  constexpr std::array<unsigned, 5> kLeast = {0, 0, 0x80, 0x800, 0x10000};
  const bool surrogate = code >= 0xD800 && code <= 0xDFFF;
  return code < kLeast[count] || surrogate || code > 0x10FFFF ? 0 : count;
}

bool is_control(char c) {
  return static_cast<unsigned char>(c) < 0x20 || c == 0x7F;
}

/// Of a name that is sent or looked up, in which every byte counts.
std::string name_fault(const std::string& text) {
  for (std::size_t at = 0; at < text.size();) {
    if (is_control(text[at]))
      return fmt::format("Character {} is a control character (0x{:02x}): delete it", at + 1,
                         static_cast<unsigned char>(text[at]));
    const std::size_t bytes = character_bytes(text, at);
    if (bytes == 0) return fmt::format("Byte {} is no text (UTF-8): type this anew", at + 1);
    at += bytes;
  }
  return "";
}

std::string port_fault(std::string_view port) {
  unsigned number = 0;
  const char* const end = port.data() + port.size();
  const auto parsed = std::from_chars(port.data(), end, number);
  if (!port.empty() && parsed.ec == std::errc() && parsed.ptr == end && number >= 1 && number <= 65535)
    return "";
  return fmt::format("Port '{}' is not a number from 1 to 65535", shown_text(std::string(port), kQuoted));
}

std::string host_fault(const std::string& host) {
  if (host.empty()) return "The host is missing before the port: HOST:PORT";
  if (host.size() > kHostMost)
    return fmt::format("A host's name has at most {} characters, this one has {}", kHostMost, host.size());
  const auto is_of_a_host = [](char c) {
    return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
           static_cast<unsigned char>(c) >= 0x80 ||
           std::string_view(".-_:%").find(c) != std::string_view::npos;
  };
  if (host.front() != '-' && std::all_of(host.begin(), host.end(), is_of_a_host)) return "";
  return fmt::format("'{}' is no host: a name or an address is expected, as in lab.example.org:5100",
                     shown_text(host, kQuoted));
}

std::string server_fault(const std::string& server) {
  if (server.empty()) return "Name a server: HOST:PORT of a telenano-nve serve";
  if (server.size() > kServerMost)
    return fmt::format("At most {} characters, these are {}", kServerMost, server.size());
  if (std::string fault = name_fault(server); !fault.empty()) return fault;
  if (server.front() == '[') {
    const std::size_t close = server.find(']');
    if (close == std::string::npos) return "The IPv6 address needs its closing bracket: [::1]:5100";
    if (close + 1 >= server.size() || server[close + 1] != ':')
      return "The server needs its port behind the bracket: [::1]:5100";
    const std::string fault = host_fault(server.substr(1, close - 1));
    return fault.empty() ? port_fault(std::string_view(server).substr(close + 2)) : fault;
  }
  const std::size_t colon = server.find(':');
  if (colon == std::string::npos) return "The server needs its port: HOST:PORT";
  if (server.find("://") != std::string::npos)
    return "Leave out what stands before the host: HOST:PORT is expected";
  if (server.find(':', colon + 1) != std::string::npos) {
    const bool address = server.find("::") != std::string::npos ||
                         server.find_first_not_of("0123456789abcdefABCDEF:.") == std::string::npos;
    return address ? "An IPv6 address needs brackets: [::1]:5100" : "One colon is expected: HOST:PORT";
  }
  const std::string fault = host_fault(server.substr(0, colon));
  return fault.empty() ? port_fault(std::string_view(server).substr(colon + 1)) : fault;
}

std::vector<std::string> entries_of(const std::string& list) {
  std::vector<std::string> entries;
  for (std::size_t from = 0; from <= list.size();) {
    const std::size_t comma = std::min(list.find(',', from), list.size());
    entries.push_back(list.substr(from, comma - from));
    from = comma + 1;
  }
  return entries;
}

/// Any bytes but a zero may be a file's name: only its length is judged here.
std::string path_fault(const std::string& path) {
  if (path.size() <= kPathMost) return "";
  return fmt::format("A file's name has at most {} characters, this one has {}", kPathMost, path.size());
}

std::string server_key_fault(const std::string& keys) {
  constexpr std::string_view kBefore = "sha256:";
  constexpr std::size_t kDigits = 64;
  if (keys.size() > kServerMost)
    return fmt::format("At most {} characters, these are {}", kServerMost, keys.size());
  for (const std::string& key : entries_of(keys)) {
    const bool whole = key.size() == kBefore.size() + kDigits && key.starts_with(kBefore) &&
                       key.find_first_not_of("0123456789abcdef", kBefore.size()) == std::string::npos;
    if (!whole)
      return "Expected sha256: and 64 lower-case hexadecimal digits, as telenano-nve keys identity prints "
             "them";
  }
  return "";
}

}  // namespace

const std::string& StartFaults::first() const noexcept {
  for (const std::string* const fault : {&server, &key, &identity, &server_key, &server_scene})
    if (!fault->empty()) return *fault;
  return recording;
}

std::string StartFaults::first_field() const {
  return !server.empty()         ? "Server"
         : !key.empty()          ? "Key file"
         : !identity.empty()     ? "Identity"
         : !server_key.empty()   ? "Server's key"
         : !server_scene.empty() ? "Sample"
         : !recording.empty()    ? "Recording"
                                 : "";
}

void StartFaults::add(const StartFaults& other) {
  const auto add = [](std::string& mine, const std::string& others) {
    if (mine.empty()) mine = others;
  };
  add(server, other.server);
  add(key, other.key);
  add(identity, other.identity);
  add(server_key, other.server_key);
  add(server_scene, other.server_scene);
  add(recording, other.recording);
}

StartFaults start_faults(const StartChoice& choice) {
  StartFaults faults;
  faults.server = server_fault(choice.server);
  faults.key = path_fault(choice.key);
  faults.identity = path_fault(choice.identity);
  if (!choice.server_key.empty()) faults.server_key = server_key_fault(choice.server_key);
  if (choice.identity.empty() && !choice.server_key.empty())
    faults.identity = "Name this station's own key pair too, or clear the server's key";
  if (!choice.identity.empty() && choice.server_key.empty())
    faults.server_key = "Name the server's key too: telenano-nve keys identity prints it";
  if (!choice.identity.empty() && !choice.key.empty())
    faults.key = "A key file or a key pair of its own: clear one";
  faults.server_scene = choice.server_scene.size() > kSceneMost
                            ? fmt::format("A sample's name has at most {} characters", kSceneMost)
                            : name_fault(choice.server_scene);
  if (choice.record)
    faults.recording = choice.recording.empty() ? "Name the recording's file, or switch it off"
                                                : path_fault(choice.recording);
  return faults;
}

bool take_flag_fault(const std::string& line, const StartChoice& choice, StartFaults& faults) {
  constexpr std::string_view kProgram = "telenano-master: ";
  constexpr std::size_t kMost = 300;  // the paths that it names may be long
  const std::string_view told =
      std::string_view(line).substr(line.starts_with(kProgram) ? kProgram.size() : 0);
  // What a file holds is told with its name alone before it.
  const std::string key = choice.key + ":";
  const std::string identity = choice.identity + ":";
  const std::array<std::pair<std::string_view, std::string*>, 9> fields = {
      {{"--server ", &faults.server},
       {"--key ", &faults.key},
       {"key file ", &faults.key},
       {"--identity ", &faults.identity},
       {"--server-key ", &faults.server_key},
       {"--server-scene ", &faults.server_scene},
       {"--record ", &faults.recording},
       {key, &faults.key},
       {identity, &faults.identity}}};
  for (const auto& [begins, field] : fields) {
    if (begins == ":" || !told.starts_with(begins)) continue;
    *field = shown_text(std::string(told), kMost);
    return true;
  }
  return false;
}

std::string shown_text(const std::string& text, std::size_t most) {
  std::string shown;
  std::size_t count = 0;
  for (std::size_t at = 0; at < text.size(); ++count) {
    if (count == most) return shown + "…";
    const std::size_t bytes = character_bytes(text, at);
    shown += bytes == 0 || is_control(text[at]) ? std::string("?") : text.substr(at, bytes);
    at += std::max<std::size_t>(bytes, 1);
  }
  return shown;
}

}  // namespace telenano::view_model

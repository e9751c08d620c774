#include "telenano/master/app/run/session_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iterator>
#include <string_view>
#include <utility>

#include "telenano/common/base/error.h"
#include "telenano/common/config/print.h"

namespace telenano::app {
namespace {

constexpr std::string_view kHead = "telenano session ";

}  // namespace

SessionFile::SessionFile(std::string path) : path_(std::move(path)) {
  if (path_.empty()) return;
  std::ifstream file(path_, std::ios::binary);
  if (!file) return;  // the first run
  char text[64] = {};
  file.read(text, sizeof text);
  std::string_view rest(text, static_cast<std::size_t>(file.gcount()));
  const bool headed = rest.substr(0, kHead.size()) == kHead;
  rest.remove_prefix(headed ? kHead.size() : rest.size());
  const auto [end, error] = std::from_chars(rest.data(), rest.data() + rest.size(), token_, 16);
  if (!headed || error != std::errc{} || std::string_view(end, rest.data() + rest.size() - end) != "\n") {
    throw UserError(
        fmt::format("--session-file {}: not a session file; choose another name, or remove it", path_));
  }
}

void SessionFile::keep(std::uint64_t token) {
  if (path_.empty() || token == token_) return;
  token_ = token;
  // Beside it, then in its place: a kill in between leaves the old one or the new one.
  const std::string fresh = path_ + ".new";
  const std::string text = fmt::format("{}{:016x}\n", kHead, token);
  const int file = ::open(fresh.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
  const bool written =
      file >= 0 && ::write(file, text.data(), text.size()) == static_cast<ssize_t>(text.size());
  if (file >= 0) ::close(file);
  if (written && std::rename(fresh.c_str(), path_.c_str()) == 0) return;
  if (!std::exchange(warned_, true)) {
    config::print(
        stderr,
        "telenano-master: warning: --session-file {}: {}; this session cannot be resumed by a new run\n",
        path_, std::strerror(errno));
  }
}

void SessionFile::remove() noexcept {
  if (!path_.empty()) ::unlink(path_.c_str());
}

}  // namespace telenano::app

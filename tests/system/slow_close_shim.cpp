// Preloaded: to close a file whose name ends as TELENANO_SLOW_CLOSE says takes as many seconds as TELENANO_SLOW_CLOSE_S says. What a
// busy disk does to a recording, for the processes of one test alone.
#include <dlfcn.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <string_view>

namespace {

bool is_slow(int file) {
  const char* const end = std::getenv("TELENANO_SLOW_CLOSE");
  if (end == nullptr || file < 0) return false;
  char link[32], name[4096];
  std::snprintf(link, sizeof link, "/proc/self/fd/%d", file);
  const ssize_t n = ::readlink(link, name, sizeof name);
  return n > 0 && std::string_view(name, static_cast<std::size_t>(n)).ends_with(end);
}

}  // namespace

extern "C" int close(int file) {
  using Call = int (*)(int);
  static const Call call = reinterpret_cast<Call>(::dlsym(RTLD_NEXT, "close"));
  if (is_slow(file)) {
    const char* const seconds = std::getenv("TELENANO_SLOW_CLOSE_S");
    ::usleep(static_cast<useconds_t>(1e6 * (seconds != nullptr ? std::atof(seconds) : 0)));
  }
  return call(file);
}

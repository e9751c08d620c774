#include "telenano/nve_server/app/serve/service_notify.h"

#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <string>

namespace telenano::app {
namespace {

/// The other end of sd_notify(3): a datagram socket whose path is in NOTIFY_SOCKET.
class ServiceManager {
 public:
  ServiceManager() {
    path_ =
        (std::filesystem::temp_directory_path() / ("telenano_notify_" + std::to_string(::getpid()))).string();
    ::unlink(path_.c_str());
    socket_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::strncpy(address.sun_path, path_.c_str(), sizeof address.sun_path - 1);
    bound_ = ::bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
    ::setenv("NOTIFY_SOCKET", path_.c_str(), 1);
  }
  ~ServiceManager() {
    for (const char* name : {"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"}) ::unsetenv(name);
    ::close(socket_);
    ::unlink(path_.c_str());
  }
  bool bound() const { return bound_; }

  /// What comes within the time, message by message with a line feed between.
  std::string hear(std::chrono::milliseconds time) const {
    const auto end = std::chrono::steady_clock::now() + time;
    std::string heard;
    for (;;) {
      const auto left =
          std::chrono::duration_cast<std::chrono::milliseconds>(end - std::chrono::steady_clock::now());
      pollfd ready{socket_, POLLIN, 0};
      if (left.count() <= 0 || ::poll(&ready, 1, static_cast<int>(left.count())) <= 0) return heard;
      char text[512];
      const ssize_t size = ::recv(socket_, text, sizeof text, 0);
      if (size > 0) heard += std::string(text, static_cast<std::size_t>(size)) + "\n";
    }
  }

 private:
  std::string path_;
  int socket_ = -1;
  bool bound_ = false;
};

bool has(const std::string& text, const char* part) {
  return text.find(part) != std::string::npos;
}

constexpr std::chrono::milliseconds kLook{400};  // some thirteen signs of life at 90 ms / 3

TEST(ServiceNotify, ReadyThenStopping) {
  const ServiceManager manager;
  ASSERT_TRUE(manager.bound());
  server::LoopStatus status;
  {
    const ServiceNotify service(status);
    EXPECT_TRUE(has(manager.hear(kLook), "READY=1"));
  }
  EXPECT_TRUE(has(manager.hear(kLook), "STOPPING=1"));
}

// The sign of life is the loop's: a thread of its own that lives while the loop hangs must not give it.
TEST(ServiceNotify, NoSignOfLifeWhileTheLoopHangs) {
  ::setenv("WATCHDOG_USEC", "90000", 1);
  const ServiceManager manager;
  server::LoopStatus status;
  const ServiceNotify service(status);
  manager.hear(kLook);
  EXPECT_FALSE(has(manager.hear(kLook), "WATCHDOG=1"));
  status.turns.fetch_add(1);
  EXPECT_TRUE(has(manager.hear(kLook), "WATCHDOG=1"));
  EXPECT_FALSE(has(manager.hear(kLook), "WATCHDOG=1"));
}

// An AFM's tip goes up after the last turn of the loop; a watchdog of three seconds killed the server meanwhile.
TEST(ServiceNotify, TheOrderlyEndMayTakeLongerThanTheWatchdog) {
  ::setenv("WATCHDOG_USEC", "90000", 1);
  const ServiceManager manager;
  server::LoopStatus status;
  {
    const ServiceNotify service(status);
    manager.hear(kLook);
  }
  EXPECT_TRUE(has(manager.hear(kLook), "STOPPING=1\nWATCHDOG_USEC=15000000"));
}

TEST(ServiceNotify, NoWatchdogNoSignOfLife) {
  const ServiceManager manager;
  server::LoopStatus status;
  const ServiceNotify service(status);
  status.turns.fetch_add(1);
  EXPECT_FALSE(has(manager.hear(kLook), "WATCHDOG"));
}

TEST(ServiceNotify, NobodyAskedNothingHappens) {
  server::LoopStatus status;
  const ServiceNotify service(status);
}

}  // namespace
}  // namespace telenano::app

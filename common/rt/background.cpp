#include "telenano/common/rt/background.h"

#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

namespace telenano::rt {

void enter_background() noexcept {
  constexpr int kNice = 10;
  // Linux keeps niceness by thread, whatever POSIX says of processes.
  setpriority(PRIO_PROCESS, static_cast<id_t>(syscall(SYS_gettid)), kNice);
}

}  // namespace telenano::rt

#include "telenano/master/app/devices/enter_key.h"

#include <poll.h>
#include <unistd.h>

#include "telenano/common/base/error.h"

namespace telenano::app {

bool enter_pressed(int wait_ms) {
  pollfd input{STDIN_FILENO, POLLIN, 0};
  if (::poll(&input, 1, wait_ms) <= 0) return false;
  char c = 0;
  if (::read(STDIN_FILENO, &c, 1) != 1) throw RunError("calibrate: end of input; nothing was written");
  return c == '\n';
}

}  // namespace telenano::app

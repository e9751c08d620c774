#include "tests/studies/stress/realtime_check.h"

namespace telenano::studies::stress {
int check_realtime(const std::string&) {
  return 0;
}
}  // namespace telenano::studies::stress

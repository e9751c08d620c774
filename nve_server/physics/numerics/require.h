#pragma once

#include <sstream>

#include "telenano/common/base/error.h"

namespace telenano::physics {

/// Of a parameter that a person has written: throws UserError "WHAT, not VALUE" unless it is good.
inline void require(bool good, const char* what, double value) {
  if (good) return;
  std::ostringstream text;
  text << what << ", not " << value;
  throw UserError(text.str());
}

}  // namespace telenano::physics

#include "common/control/method.h"

#include <array>
#include <string>

#include "common/base/error.h"

namespace telenano::control {
namespace {

constexpr std::array<std::string_view, 8> kNames = {"none", "ks",   "ks-clamp", "tdpa",
                                                    "wave", "tank", "model",    "twin"};

}  // namespace

std::string_view method_name(Method method) noexcept {
  const auto index = static_cast<std::size_t>(method);
  return index < kNames.size() ? kNames[index] : "unknown";
}

Method parse_method(std::string_view name) {
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    if (kNames[i] == name) return static_cast<Method>(i);
  }
  throw UserError("method '" + std::string(name) +
                  "' is unknown; use none, ks, ks-clamp, tdpa, wave, tank, model or twin");
}

}  // namespace telenano::control

#include "common/control/method.h"

#include <array>
#include <string>

#include "common/base/error.h"

namespace telenano::control {
namespace {

constexpr std::array<std::string_view, 7> kNames = {"none", "ks",   "ks-clamp", "tdpa",
                                                    "wave", "tank", "model"};

}  // namespace

std::string_view method_name(Method method) noexcept {
  const auto index = static_cast<std::size_t>(method);
  return index < kNames.size() ? kNames[index] : "unknown";
}

bool method_available(Method method) noexcept {
  return method == Method::kNone || method == Method::kKs || method == Method::kKsClamp;
}

bool claims_energy_bound(Method method) noexcept {
  return method == Method::kKsClamp || method == Method::kTank || method == Method::kModel;
}

Method parse_method(std::string_view name) {
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    if (kNames[i] != name) continue;
    const auto method = static_cast<Method>(i);
    if (!method_available(method)) {
      throw UserError("method '" + std::string(name) +
                      "' is reserved but not available in this version; use none, ks or ks-clamp");
    }
    return method;
  }
  throw UserError("method '" + std::string(name) + "' is unknown; use none, ks or ks-clamp");
}

}  // namespace telenano::control

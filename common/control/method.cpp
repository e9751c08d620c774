#include "telenano/common/control/method.h"

#include <array>
#include <optional>
#include <string>

#include "telenano/common/base/error.h"

namespace telenano::control {
namespace {

constexpr std::array<std::string_view, 8> kNames = {"none", "ks",   "ks-clamp", "tdpa",
                                                    "wave", "tank", "model",    "twin"};

}  // namespace

std::string_view method_name(Method method) noexcept {
  const auto index = static_cast<std::size_t>(method);
  return index < kNames.size() ? kNames[index] : "unknown";
}

std::optional<Method> find_method(std::string_view name) noexcept {
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    if (kNames[i] == name) return static_cast<Method>(i);
  }
  return std::nullopt;
}

std::string method_list() {
  std::string list;
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    if (i > 0) list += i + 1 < kNames.size() ? ", " : " or ";
    list += kNames[i];
  }
  return list;
}

Method parse_method(std::string_view name) {
  if (const auto method = find_method(name)) return *method;
  throw UserError("method '" + std::string(name) + "' is unknown; use " + method_list());
}

}  // namespace telenano::control

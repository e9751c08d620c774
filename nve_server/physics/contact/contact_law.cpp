#include "telenano/nve_server/physics/contact/contact_law.h"

#include <array>
#include <cstddef>

namespace telenano::physics {
namespace {

// In the order of the enumerations.
constexpr std::array<std::string_view, 7> kModels = {
    "hertz", "dmt", "jkr", "maugis-dugdale", "cos", "pietrement-troyon", "schwarz"};
static_assert(kModels.size() == kContactLaws.size());
constexpr std::array<std::string_view, 2> kMethods = {"direct", "table"};

template <class Value, std::size_t N>
std::optional<Value> find(const std::array<std::string_view, N>& names, std::string_view name) noexcept {
  for (std::size_t i = 0; i < N; ++i) {
    if (names[i] == name) return static_cast<Value>(i);
  }
  return std::nullopt;
}

}  // namespace

std::string_view contact_law_name(ContactLaw model) noexcept {
  return kModels[static_cast<std::size_t>(model)];
}
std::optional<ContactLaw> contact_law_from_name(std::string_view name) noexcept {
  return find<ContactLaw>(kModels, name);
}
std::string_view maugis_method_name(MaugisMethod method) noexcept {
  return kMethods[static_cast<std::size_t>(method)];
}
std::optional<MaugisMethod> maugis_method_from_name(std::string_view name) noexcept {
  return find<MaugisMethod>(kMethods, name);
}

}  // namespace telenano::physics

#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

namespace telenano::physics {

/// The contact laws on offer. Maugis–Dugdale is exact for a Dugdale stress; the others are its limits (Hertz,
/// DMT, JKR) or closed-form fits between them (closed_form_laws.h, with their error against it).
enum class ContactLaw : std::uint8_t {
  kHertz,
  kDmt,
  kJkr,
  kMaugisDugdale,
  kCarpickOgletreeSalmeron,
  kPietrementTroyon,
  kSchwarz
};

/// All of them, in the order of the enumeration. Scenes take their names from here, and the tests that go over
/// every law.
inline constexpr std::array kContactLaws{ContactLaw::kHertz,
                                         ContactLaw::kDmt,
                                         ContactLaw::kJkr,
                                         ContactLaw::kMaugisDugdale,
                                         ContactLaw::kCarpickOgletreeSalmeron,
                                         ContactLaw::kPietrementTroyon,
                                         ContactLaw::kSchwarz};

/// How Maugis–Dugdale is evaluated: by Newton's method at any radius, or from a table made for one radius.
enum class MaugisMethod : std::uint8_t { kDirect, kTable };

/// "hertz", "dmt", "jkr", "maugis-dugdale", "cos", "pietrement-troyon", "schwarz".
std::string_view contact_law_name(ContactLaw model) noexcept;
std::optional<ContactLaw> contact_law_from_name(std::string_view name) noexcept;

/// "direct", "table".
std::string_view maugis_method_name(MaugisMethod method) noexcept;
std::optional<MaugisMethod> maugis_method_from_name(std::string_view name) noexcept;

}  // namespace telenano::physics

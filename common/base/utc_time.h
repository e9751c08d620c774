#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace telenano {

/// Moments of the calendar as people and files write them: RFC 3339 in UTC, to the second
/// ("2027-01-31T12:00:00Z"). Numbers are seconds since 1970-01-01T00:00:00Z without leap seconds (Unix time),
/// years 1970 to 9999.
std::string utc_text(std::int64_t unix_s);

/// None unless the text is exactly of that form and the moment exists (no 30th of February, no 24:00).
std::optional<std::int64_t> parse_utc(std::string_view text) noexcept;

}  // namespace telenano

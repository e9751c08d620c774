#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace telenano::config {

/// Letters to insert, delete, replace or swap with their neighbour to turn one word into the other (optimal
/// string alignment distance).
std::size_t edit_distance(std::string_view a, std::string_view b);

/// The name most like `written`, or "" if none is near enough to be what was meant: at most a third of the
/// letters differ, or the two differ in nothing but the last part after '_' (the unit).
std::string nearest_name(std::string_view written, const std::vector<std::string>& names);

}  // namespace telenano::config

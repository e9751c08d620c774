#pragma once

#include <string>
#include <string_view>

namespace telenano::fit {

/// A scene's text with `table.key = value` in place of what was there, comments and all else as they are; a
/// table or key that is missing is added. `value` is TOML. What a text may say in other ways (dotted keys,
/// inline tables) is not looked for: whoever edits reads the result again.
std::string with_key(std::string_view text, std::string_view table, std::string_view key,
                     std::string_view value);

/// The text without such a line, if there is one.
std::string without_key(std::string_view text, std::string_view table, std::string_view key);

}  // namespace telenano::fit

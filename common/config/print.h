#pragma once

#include <fmt/format.h>

#include <cstdio>
#include <exception>
#include <string>
#include <utility>

namespace telenano::config {

/// As fmt::print, but what cannot be written is dropped, for a full disk or a reader that has gone must not end a
/// session. That standard output was not written run_program tells in the end.
template <typename... Values>
void print(std::FILE* file, fmt::format_string<Values...> format, Values&&... values) noexcept {
  try {
    const std::string text = fmt::format(format, std::forward<Values>(values)...);
    std::fwrite(text.data(), 1, text.size(), file);
  } catch (const std::exception&) {  // no memory: dropped too
  }
}

}  // namespace telenano::config

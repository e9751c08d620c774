#include "tests/studies/parse_list.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>

#include "telenano/common/base/error.h"

namespace telenano::studies {

std::vector<double> parse_list(const std::string& text, const std::string& what) {
  std::vector<double> values;
  std::size_t begin = 0;
  while (begin <= text.size()) {
    const std::size_t end = std::min(text.find(',', begin), text.size());
    std::size_t first = begin;
    std::size_t last = end;
    while (first < last && text[first] == ' ') ++first;
    while (last > first && text[last - 1] == ' ') --last;
    if (first < last && text[first] == '+') ++first;
    double value = 0;
    const auto [stop, error] = std::from_chars(text.data() + first, text.data() + last, value);
    if (error != std::errc{} || stop != text.data() + last) {
      throw UserError(fmt::format("{}: '{}' is not a number; expected numbers separated by commas", what,
                                  text.substr(begin, end - begin)));
    }
    values.push_back(value);
    begin = end + 1;
  }
  return values;
}

}  // namespace telenano::studies

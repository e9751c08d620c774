#include "telenano/nve_server/fit/fitted_scene.h"

#include <algorithm>

namespace telenano::fit {
namespace {

std::string_view trimmed(std::string_view line) {
  while (!line.empty() && (line.front() == ' ' || line.front() == '\t')) line.remove_prefix(1);
  while (!line.empty() && (line.back() == ' ' || line.back() == '\t' || line.back() == '\r'))
    line.remove_suffix(1);
  return line;
}

bool heads(std::string_view line, std::string_view table) {
  line = trimmed(line);
  if (!line.starts_with("[")) return false;
  line.remove_prefix(1);
  const std::size_t end = line.find(']');
  return end != std::string_view::npos && trimmed(line.substr(0, end)) == table;
}

bool sets(std::string_view line, std::string_view key) {
  line = trimmed(line);
  if (!line.starts_with(key)) return false;
  return trimmed(line.substr(key.size())).starts_with("=");
}

}  // namespace

std::string with_key(std::string_view text, std::string_view table, std::string_view key,
                     std::string_view value) {
  const std::string said = std::string(key) + " = " + std::string(value) + "   # fitted\n";
  std::string out;
  bool in_table = false;
  bool done = false;
  std::size_t after_head = 0;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    const std::string_view line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    if (trimmed(line).starts_with("[")) {
      // The table ends without the key: it goes below the head, whose place is known.
      if (in_table && !done) {
        out.insert(after_head, said);
        done = true;
      }
      in_table = !done && heads(line, table);
    } else if (in_table && !done && sets(line, key)) {
      out += said;
      done = true;
      continue;
    }
    out += std::string(line) + "\n";
    if (in_table && heads(line, table)) after_head = out.size();
  }
  if (!done && in_table) {
    out.insert(after_head, said);
  } else if (!done) {
    out += "\n[" + std::string(table) + "]\n" + said;
  }
  return out;
}

std::string without_key(std::string_view text, std::string_view table, std::string_view key) {
  std::string out;
  bool in_table = false;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    const std::string_view line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    if (trimmed(line).starts_with("[")) in_table = heads(line, table);
    if (!in_table || !sets(line, key)) out += std::string(line) + "\n";
  }
  return out;
}

}  // namespace telenano::fit

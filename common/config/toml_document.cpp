#include "telenano/common/config/toml_document.h"

#include <toml++/toml.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>
#include <string_view>
#include <type_traits>
#include <utility>

#include "telenano/common/base/error.h"
#include "telenano/common/config/edit_distance.h"

namespace telenano::config {
namespace {

struct Shared {
  std::string path;
  toml::table root;
};

/// What a file says may hold anything; quoted in an error it must not make two lines of it, nor reach a
/// terminal as a command.
[[noreturn]] void refuse(const std::string& line) {
  std::string text;
  for (const char c : line) {
    const auto byte = static_cast<unsigned char>(c);
    if (byte >= 0x20 && byte != 0x7f) {
      text += c;
    } else {
      constexpr std::string_view kDigits = "0123456789abcdef";
      text.append("\\x").append({kDigits[byte >> 4], kDigits[byte & 15]});
    }
  }
  throw UserError(text);
}

std::string number_in(const Range& range) {
  const std::string text = range.text();
  return text.front() == 'a' ? text : "a number " + text;
}

std::string format_number(double x) {
  std::ostringstream out;
  out.precision(12);
  out << x;
  return out.str();
}

}  // namespace

bool Range::contains(double x) const noexcept {
  if (!std::isfinite(x)) return false;
  return (min_open ? x > min : x >= min) && (max_open ? x < max : x <= max);
}

std::string Range::text() const {
  const bool has_min = std::isfinite(min);
  const bool has_max = std::isfinite(max);
  if (!has_min && !has_max) return "a finite number";
  if (!has_max) return (min_open ? "> " : ">= ") + format_number(min);
  if (!has_min) return (max_open ? "< " : "<= ") + format_number(max);
  return std::string("in ") + (min_open ? "(" : "[") + format_number(min) + ", " + format_number(max) +
         (max_open ? ")" : "]");
}

struct TomlTable::Node {
  std::shared_ptr<Shared> shared;
  const toml::table* table = nullptr;
  std::string name;                     // "" for the root, "sample", "task[1]"
  mutable std::set<std::string> known;  // every key asked for, present or not
  mutable std::vector<std::shared_ptr<const Node>> children;

  std::string where(const toml::node* at) const {
    std::string text = shared->path;
    const auto line = at != nullptr ? at->source().begin.line : table->source().begin.line;
    if (line != 0) text.append(":").append(std::to_string(line));
    return text.append(": ");
  }
  std::string in_table() const { return name.empty() ? " at the top level" : " in [" + name + "]"; }

  [[noreturn]] void unknown(const std::string& key, const toml::node& at) const {
    std::string line = where(&at) + "unknown " +
                       (at.is_table() || at.is_array_of_tables() ? "table" : "key") + " '" + key + "'" +
                       in_table();
    const std::string near = nearest_name(key, {known.begin(), known.end()});
    if (!near.empty()) line += "; did you mean '" + near + "'?";
    refuse(line);
  }

  const toml::node* find(std::string_view key) const {
    known.emplace(key);
    return table->get(key);
  }

  void refuse_if_misspelt(std::string_view key) const {
    for (const auto& [name_in_file, value] : *table) {
      const std::string written(name_in_file.str());
      if (known.count(written) == 0 && nearest_name(written, {std::string(key)}) == key)
        unknown(written, value);
    }
  }

  // A required key that is absent is most often one spelt otherwise, or in another unit: look for it first.
  const toml::node& need(std::string_view key, const std::string& expected) const {
    if (const toml::node* node = find(key)) return *node;
    refuse_if_misspelt(key);
    refuse(where(nullptr) + "missing key '" + std::string(key) + "'" + in_table() + " (expected " + expected +
           ")");
  }

  [[noreturn]] void wrong(std::string_view key, const toml::node& at, const std::string& found,
                          const std::string& expected) const {
    refuse(where(&at) + "'" + std::string(key) + "'" + in_table() + " is " + found + ", expected " +
           expected);
  }

  double as_number(std::string_view key, const toml::node& node, const Range& range) const {
    const std::string expected = number_in(range);
    if (!node.is_integer() && !node.is_floating_point()) wrong(key, node, kind(node), expected);
    const double value = *node.value<double>();
    if (!range.contains(value)) wrong(key, node, format_number(value), expected);
    return value;
  }

  std::int64_t as_integer(std::string_view key, const toml::node& node, std::int64_t min,
                          std::int64_t max) const {
    const std::string expected = "an integer in [" + std::to_string(min) + ", " + std::to_string(max) + "]";
    if (!node.is_integer()) wrong(key, node, kind(node), expected);
    const std::int64_t value = *node.value<std::int64_t>();
    if (value < min || value > max) wrong(key, node, std::to_string(value), expected);
    return value;
  }

  std::string as_text(std::string_view key, const toml::node& node) const {
    if (!node.is_string()) wrong(key, node, kind(node), "a text in quotes");
    return *node.value<std::string>();
  }

  std::string as_choice(std::string_view key, const toml::node& node,
                        const std::vector<std::string>& choices) const {
    const std::string expected = list(choices);
    if (!node.is_string()) wrong(key, node, kind(node), expected);
    std::string value = *node.value<std::string>();
    if (std::find(choices.begin(), choices.end(), value) == choices.end()) {
      wrong(key, node, "'" + value + "'", expected);
    }
    return value;
  }

  bool as_boolean(std::string_view key, const toml::node& node) const {
    if (!node.is_boolean()) wrong(key, node, kind(node), "true or false");
    return *node.value<bool>();
  }

  static std::string list(const std::vector<std::string>& choices) {
    std::string text = "one of";
    for (std::size_t i = 0; i < choices.size(); ++i)
      text.append(i == 0 ? " '" : ", '").append(choices[i]).append("'");
    return text;
  }

  static std::string kind(const toml::node& node) {
    switch (node.type()) {
      case toml::node_type::table:
        return "a table";
      case toml::node_type::array:
        return "an array";
      case toml::node_type::string:
        return "a text";
      case toml::node_type::integer:
        return "an integer";
      case toml::node_type::floating_point:
        return "a decimal number";
      case toml::node_type::boolean:
        return "true or false";
      default:
        return "a date or time";
    }
  }
};

bool TomlTable::has(std::string_view key) const {
  return node_->find(key) != nullptr;
}

double TomlTable::number(std::string_view key, const Range& range) const {
  return node_->as_number(key, node_->need(key, number_in(range)), range);
}

std::optional<double> TomlTable::optional_number(std::string_view key, const Range& range) const {
  const toml::node* node = node_->find(key);
  if (node == nullptr) return std::nullopt;
  return node_->as_number(key, *node, range);
}

double TomlTable::number_or(std::string_view key, const Range& range, double fallback) const {
  return optional_number(key, range).value_or(fallback);
}

std::int64_t TomlTable::integer(std::string_view key, std::int64_t min, std::int64_t max) const {
  const std::string expected = "an integer in [" + std::to_string(min) + ", " + std::to_string(max) + "]";
  return node_->as_integer(key, node_->need(key, expected), min, max);
}

std::int64_t TomlTable::integer_or(std::string_view key, std::int64_t min, std::int64_t max,
                                   std::int64_t fallback) const {
  const toml::node* node = node_->find(key);
  return node == nullptr ? fallback : node_->as_integer(key, *node, min, max);
}

bool TomlTable::boolean(std::string_view key) const {
  return node_->as_boolean(key, node_->need(key, "true or false"));
}

bool TomlTable::boolean_or(std::string_view key, bool fallback) const {
  const toml::node* node = node_->find(key);
  return node == nullptr ? fallback : node_->as_boolean(key, *node);
}

std::string TomlTable::text(std::string_view key) const {
  return node_->as_text(key, node_->need(key, "a text in quotes"));
}

std::string TomlTable::text_or(std::string_view key, std::string_view fallback) const {
  const toml::node* node = node_->find(key);
  return node == nullptr ? std::string(fallback) : node_->as_text(key, *node);
}

std::string TomlTable::choice(std::string_view key, const std::vector<std::string>& choices) const {
  return node_->as_choice(key, node_->need(key, Node::list(choices)), choices);
}

std::string TomlTable::choice_or(std::string_view key, const std::vector<std::string>& choices,
                                 std::string_view fallback) const {
  const toml::node* node = node_->find(key);
  return node == nullptr ? std::string(fallback) : node_->as_choice(key, *node, choices);
}

std::vector<double> TomlTable::numbers(std::string_view key, const Range& range, std::size_t min_count,
                                       std::size_t max_count) const {
  const std::string count = min_count == max_count
                                ? std::to_string(min_count)
                                : std::to_string(min_count) + " to " + std::to_string(max_count);
  const std::string expected = "an array of " + count + " numbers, each " + range.text();
  const toml::node& node = node_->need(key, expected);
  const toml::array* array = node.as_array();
  if (array == nullptr) node_->wrong(key, node, Node::kind(node), expected);
  if (array->size() < min_count || array->size() > max_count) {
    node_->wrong(key, node, "an array of " + std::to_string(array->size()), expected);
  }
  std::vector<double> values;
  values.reserve(array->size());
  for (std::size_t i = 0; i < array->size(); ++i) {
    const std::string element = std::string(key) + "[" + std::to_string(i) + "]";
    values.push_back(node_->as_number(element, *array->get(i), range));
  }
  return values;
}

std::optional<TomlTable> TomlTable::optional_table(std::string_view key) const {
  const toml::node* node = node_->find(key);
  if (node == nullptr) return std::nullopt;
  const std::string name = node_->name.empty() ? std::string(key) : node_->name + "." + std::string(key);
  if (!node->is_table()) node_->wrong(key, *node, Node::kind(*node), "a table [" + name + "]");
  for (const auto& child : node_->children) {
    if (child->table == node->as_table()) {
      TomlTable same;
      same.node_ = child;
      return same;
    }
  }
  auto child = std::make_shared<Node>();
  child->shared = node_->shared;
  child->table = node->as_table();
  child->name = name;
  node_->children.push_back(child);
  TomlTable result;
  result.node_ = child;
  return result;
}

TomlTable TomlTable::table(std::string_view key) const {
  node_->need(key, "a table [" + std::string(key) + "]");
  return *optional_table(key);
}

std::vector<TomlTable> TomlTable::tables(std::string_view key) const {
  std::vector<TomlTable> result;
  const toml::node* node = node_->find(key);
  if (node == nullptr) return result;
  const std::string name = node_->name.empty() ? std::string(key) : node_->name + "." + std::string(key);
  const toml::array* array = node->as_array();
  if (array == nullptr) node_->wrong(key, *node, Node::kind(*node), "tables [[" + name + "]]");
  for (std::size_t i = 0; i < array->size(); ++i) {
    const toml::node& element = *array->get(i);
    if (!element.is_table()) node_->wrong(key, element, Node::kind(element), "a table [[" + name + "]]");
    auto child = std::make_shared<Node>();
    child->shared = node_->shared;
    child->table = element.as_table();
    child->name = name + "[" + std::to_string(i) + "]";
    node_->children.push_back(child);
    TomlTable handle;
    handle.node_ = child;
    result.push_back(handle);
  }
  return result;
}

void TomlTable::fail(std::string_view key, const std::string& message) const {
  // What is missed may be there, spelt otherwise.
  if (node_->table->get(key) == nullptr) node_->refuse_if_misspelt(key);
  refuse(node_->where(node_->table->get(key)) + "'" + std::string(key) + "'" + node_->in_table() + ": " +
         message);
}

namespace {
constexpr std::size_t kFileBytesMax = std::size_t{1} << 20;  // ours have 2 KiB
}  // namespace

TomlDocument TomlDocument::load(const std::string& path) {
  std::error_code error;
  if (std::filesystem::is_directory(path, error)) {
    throw UserError(path + ": is a folder, expected a TOML file");
  }
  std::ifstream file(path, std::ios::binary);
  if (!file) throw UserError(path + ": cannot be read: " + std::strerror(errno));
  // A device or a wrong file may have no end.
  std::string content(kFileBytesMax + 1, '\0');
  file.read(content.data(), static_cast<std::streamsize>(content.size()));
  content.resize(static_cast<std::size_t>(file.gcount()));
  if (content.size() > kFileBytesMax) throw UserError(path + ": is longer than 1 MiB, expected a TOML file");
  return parse(std::move(content), path);
}

TomlDocument TomlDocument::parse(std::string content, const std::string& name) {
  auto shared = std::make_shared<Shared>();
  shared->path = name;
  try {
    shared->root = toml::parse(std::string_view(content), std::string_view(name));
  } catch (const toml::parse_error& error) {
    std::string what(error.description());
    std::replace(what.begin(), what.end(), '\n', ' ');
    refuse(name + ":" + std::to_string(error.source().begin.line) + ": not valid TOML: " + what);
  }
  auto node = std::make_shared<TomlTable::Node>();
  node->table = &shared->root;
  node->shared = std::move(shared);
  TomlDocument document;
  document.path_ = name;
  document.content_ = std::move(content);
  document.root_.node_ = node;
  return document;
}

namespace {

constexpr std::size_t kTablesDeepMax = 8;

bool is_plain_key(std::string_view key) noexcept {
  return !key.empty() && std::all_of(key.begin(), key.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_';
  });
}

void collect(const toml::table& table, const std::string& before, const std::string& name,
             std::vector<TomlValue>& values) {
  for (const auto& [key, node] : table) {
    const std::string path = before + std::string(key.str());
    if (!is_plain_key(key.str())) refuse(name + ": key '" + path + "' may contain only a-z, 0-9 and _");
    if (const toml::table* const inner = node.as_table()) {
      if (inner->empty()) values.push_back({path, std::monostate{}});
      collect(*inner, path + ".", name, values);
    } else if (node.is_boolean()) {
      values.push_back({path, *node.value<bool>()});
    } else if (node.is_integer()) {
      values.push_back({path, *node.value<std::int64_t>()});
    } else if (node.is_floating_point()) {
      values.push_back({path, *node.value<double>()});
    } else if (node.is_string()) {
      values.push_back({path, *node.value<std::string>()});
    } else {
      refuse(name + ": '" + path + "' is not a number, text, true or false");
    }
  }
}

void put(toml::table& table, const std::string& key, const TomlValue::Held& held) {
  std::visit(
      [&](const auto& value) {
        if constexpr (std::is_same_v<std::decay_t<decltype(value)>, std::monostate>)
          table.insert(key, toml::table{});
        else
          table.insert(key, value);
      },
      held);
}

}  // namespace

std::vector<TomlValue> TomlDocument::values() const {
  std::vector<TomlValue> values;
  collect(root_.node_->shared->root, "", path_, values);
  std::sort(values.begin(), values.end(),
            [](const TomlValue& a, const TomlValue& b) { return a.path < b.path; });
  return values;
}

TomlDocument TomlDocument::from_values(const std::vector<TomlValue>& values, std::string content,
                                       const std::string& name) {
  auto shared = std::make_shared<Shared>();
  shared->path = name;
  for (const TomlValue& entry : values) {
    toml::table* table = &shared->root;
    std::string_view left = entry.path;
    for (std::size_t deep = 0;; ++deep) {
      const std::size_t dot = left.find('.');
      const std::string key(left.substr(0, dot));
      if (!is_plain_key(key)) refuse(name + ": key '" + entry.path + "' may contain only a-z, 0-9 and _");
      if (deep > kTablesDeepMax) refuse(name + ": '" + entry.path + "' is nested too deeply");
      if (dot == std::string_view::npos) {
        if (table->contains(key)) refuse(name + ": '" + entry.path + "' comes twice");
        put(*table, key, entry.value);
        break;
      }
      if (!table->contains(key)) table->insert(key, toml::table{});
      table = table->get(key)->as_table();
      if (table == nullptr) refuse(name + ": '" + entry.path + "' leads through a value");
      left.remove_prefix(dot + 1);
    }
  }
  auto node = std::make_shared<TomlTable::Node>();
  node->table = &shared->root;
  node->shared = std::move(shared);
  TomlDocument document;
  document.path_ = name;
  document.content_ = std::move(content);
  document.root_.node_ = node;
  return document;
}

std::string TomlDocument::resolve(const std::string& path) const {
  const std::filesystem::path asked(path);
  if (asked.is_absolute()) return asked.string();
  return (std::filesystem::path(path_).parent_path() / asked).lexically_normal().string();
}

void TomlDocument::finish() const {
  const auto visit = [](const auto& self, const TomlTable::Node& node) -> void {
    for (const auto& [key, value] : *node.table) {
      const std::string written(key.str());
      if (node.known.count(written) == 0) node.unknown(written, value);
    }
    for (const auto& child : node.children) self(self, *child);
  };
  visit(visit, *root_.node_);
}

}  // namespace telenano::config

#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

/// The only door to toml++. A configuration is read key by key, each with the range that makes sense;
/// whatever is wrong becomes one line naming file, line, key and expected range (UserError). Two traps of
/// toml++ are closed here: it takes nan and inf for numbers, and it never reports a key that nobody asked
/// for.
namespace telenano::config {

/// Closed at both ends unless an end is marked open. Infinite ends are no limit; values themselves are always
/// finite.
struct Range {
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
  bool min_open = false;
  bool max_open = false;

  bool contains(double x) const noexcept;
  std::string text() const;  ///< e.g. "(-1, 0.5]", "> 0"
};
inline Range positive(double max = std::numeric_limits<double>::infinity()) {
  return {0.0, max, true, false};
}
inline Range at_least(double min) {
  return {min, std::numeric_limits<double>::infinity(), false, false};
}
inline Range between(double min, double max) {
  return {min, max, false, false};
}

class TomlDocument;

/// One value of a document and where it stands: "probe.tip.poisson_ratio". A table without keys, which may
/// mean something by being there, is a std::monostate.
struct TomlValue {
  using Held = std::variant<std::monostate, bool, std::int64_t, double, std::string>;
  std::string path;
  Held value;
  friend bool operator==(const TomlValue&, const TomlValue&) = default;
};

/// A table of the document: a light handle, valid while a copy of its document lives. Asking for a key,
/// present or not, makes it known: what stays unknown is reported by TomlDocument::finish().
class TomlTable {
 public:
  bool has(std::string_view key) const;

  double number(std::string_view key, const Range& range) const;
  double number_or(std::string_view key, const Range& range, double fallback) const;
  std::optional<double> optional_number(std::string_view key, const Range& range) const;
  std::int64_t integer(std::string_view key, std::int64_t min, std::int64_t max) const;
  std::int64_t integer_or(std::string_view key, std::int64_t min, std::int64_t max,
                          std::int64_t fallback) const;
  bool boolean(std::string_view key) const;
  bool boolean_or(std::string_view key, bool fallback) const;
  std::string text(std::string_view key) const;
  std::string text_or(std::string_view key, std::string_view fallback) const;
  std::string choice(std::string_view key, const std::vector<std::string>& choices) const;
  std::string choice_or(std::string_view key, const std::vector<std::string>& choices,
                        std::string_view fallback) const;
  std::vector<double> numbers(std::string_view key, const Range& range, std::size_t min_count,
                              std::size_t max_count) const;

  TomlTable table(std::string_view key) const;                          ///< must exist
  std::optional<TomlTable> optional_table(std::string_view key) const;  ///< may be left out
  std::vector<TomlTable> tables(std::string_view key) const;            ///< [[key]], none if left out

  /// Throws UserError "file:line: [table] key: message", for what only the caller can judge.
  [[noreturn]] void fail(std::string_view key, const std::string& message) const;

 private:
  friend class TomlDocument;
  struct Node;
  std::shared_ptr<const Node> node_;
};

class TomlDocument {
 public:
  static TomlDocument load(const std::string& path);
  static TomlDocument parse(std::string content, const std::string& name);
  /// The document that has these values, without reading any text; `content` is kept as it is. Each key may
  /// have lower-case letters, digits and '_'. Throws UserError for other keys, for more than 8 tables in each
  /// other, and where a path comes twice or leads through a value.
  static TomlDocument from_values(const std::vector<TomlValue>& values, std::string content,
                                  const std::string& name);

  /// All of its values by rising path. Throws UserError for what TomlValue cannot hold: arrays, dates, keys
  /// that from_values() does not take.
  std::vector<TomlValue> values() const;

  TomlTable root() const { return root_; }
  const std::string& path() const { return path_; }
  const std::string& content() const { return content_; }  ///< as read, for hashing and recording
  /// A path written in the document, relative to the document's own folder unless absolute.
  std::string resolve(const std::string& path) const;
  /// Throws UserError for the first key that nobody asked for, with the nearest known one.
  void finish() const;

 private:
  TomlDocument() = default;
  std::string path_;
  std::string content_;
  TomlTable root_;
};

}  // namespace telenano::config

#include "telenano/nve_server/scene/scene_bundle.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <utility>
#include <variant>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/scene/readers.h"

namespace telenano::scene {
namespace {

constexpr std::string_view kMagic = "TLNB";
constexpr std::uint32_t kFormVersion = 1;
constexpr const char* kName = "scene bundle";
constexpr const char* kTextEntry = "scene.toml";
constexpr const char* kValuesEntry = "values";
constexpr const char* kScanKey = "surface.file";
constexpr std::size_t kPathBytesMax = 128;
constexpr std::size_t kTextValueBytesMax = 1024;

enum class Kind : std::uint8_t { kTable, kTruth, kInteger, kNumber, kText };

[[noreturn]] void refuse(const std::string& what) {
  throw UserError(std::string(kName) + ": " + what);
}

// What a stranger wrote, kept to one short printable piece.
std::string shown(std::string_view text) {
  std::string result = "'";
  for (const char c : text.substr(0, 40)) result += c >= 0x20 && c < 0x7f ? c : '?';
  return result + "'";
}

bool is_control(char c) noexcept {
  const auto byte = static_cast<unsigned char>(c);
  return byte < 0x20 || byte == 0x7f;
}

void put(std::string& bytes, std::uint64_t value, int size) {
  for (int i = 0; i < size; ++i) bytes.push_back(static_cast<char>(value >> (8 * i) & 0xff));
}

void put_entry(std::string& bytes, std::string_view name, std::string_view content) {
  if (content.size() > UINT32_MAX) throw UserError("the scene is too large for a bundle");
  put(bytes, name.size(), 1);
  bytes += name;
  put(bytes, content.size(), 4);
  bytes += content;
}

std::string values_bytes(const std::vector<config::TomlValue>& values) {
  std::string bytes;
  put(bytes, values.size(), 4);
  for (const config::TomlValue& entry : values) {
    put(bytes, entry.value.index(), 1);
    put(bytes, entry.path.size(), 1);
    bytes += entry.path;
    if (const bool* const truth = std::get_if<bool>(&entry.value)) put(bytes, *truth ? 1 : 0, 1);
    if (const auto* const integer = std::get_if<std::int64_t>(&entry.value))
      put(bytes, static_cast<std::uint64_t>(*integer), 8);
    if (const double* const number = std::get_if<double>(&entry.value))
      put(bytes, std::bit_cast<std::uint64_t>(*number), 8);
    if (const auto* const text = std::get_if<std::string>(&entry.value)) {
      put(bytes, text->size(), 2);
      bytes += *text;
    }
  }
  return bytes;
}

// Names of files are the machine's that has them.
std::vector<config::TomlValue> values_without_paths(const config::TomlDocument& document, bool scan) {
  std::vector<config::TomlValue> values = document.values();
  for (config::TomlValue& entry : values) {
    if (scan && entry.path == kScanKey) entry.value = std::string(kGivenScan);
  }
  return values;
}

std::string encode(const config::TomlDocument& document, const std::string& scan) {
  std::string bytes(kMagic);
  put(bytes, kFormVersion, 4);
  put(bytes, kPhysicsVersion, 4);
  put(bytes, scan.empty() ? 2 : 3, 4);
  if (!scan.empty()) put_entry(bytes, kGivenScan, scan);
  put_entry(bytes, kTextEntry, document.content());
  put_entry(bytes, kValuesEntry, values_bytes(values_without_paths(document, !scan.empty())));
  return bytes;
}

SceneWithBundle make_both(const config::TomlDocument& document, const SceneLoading& loading = {}) {
  SceneWithBundle both;
  std::string scan;
  both.scene = make_scene(document, loading, nullptr, &scan);
  try {
    both.bundle = encode(document, scan);
    open_bundle(both.bundle);
  } catch (const UserError& error) {
    both.bundle.clear();
    both.why_none = error.what();
  }
  return both;
}

/// Takes bytes off the front of what is left.
class Reader {
 public:
  Reader(std::string_view bytes, const char* of) : left_(bytes), of_(of) {}

  std::string_view take(std::size_t size) {
    if (size > left_.size()) refuse(std::string(of_) + " ends early");
    const std::string_view taken = left_.substr(0, size);
    left_.remove_prefix(size);
    return taken;
  }
  std::uint64_t number(int size) {
    const std::string_view bytes = take(static_cast<std::size_t>(size));
    std::uint64_t value = 0;
    for (int i = size - 1; i >= 0; --i)
      value = value << 8 | static_cast<unsigned char>(bytes[static_cast<std::size_t>(i)]);
    return value;
  }
  std::size_t left() const noexcept { return left_.size(); }
  void finish() const {
    if (!left_.empty()) refuse(std::to_string(left_.size()) + " bytes after the end of " + of_);
  }

 private:
  std::string_view left_;
  const char* of_;
};

config::TomlValue::Held take_value(Reader& from, Kind kind, const std::string& path) {
  switch (kind) {
    case Kind::kTable:
      return std::monostate{};
    case Kind::kTruth: {
      const std::uint64_t truth = from.number(1);
      if (truth > 1) refuse("value " + shown(path) + " is neither true nor false");
      return truth == 1;
    }
    case Kind::kInteger:
      return static_cast<std::int64_t>(from.number(8));
    case Kind::kNumber: {
      const double number = std::bit_cast<double>(from.number(8));
      if (!std::isfinite(number)) refuse("value " + shown(path) + " is not finite");
      return number;
    }
    case Kind::kText: {
      const std::uint64_t size = from.number(2);
      if (size > kTextValueBytesMax) refuse("value " + shown(path) + " is longer than 1024 bytes");
      const std::string_view text = from.take(size);
      if (std::any_of(text.begin(), text.end(), is_control))
        refuse("value " + shown(path) + " has control characters");
      return std::string(text);
    }
  }
  refuse("value " + shown(path) + " is of an unknown kind");
}

std::vector<config::TomlValue> take_values(std::string_view bytes, const BundleLimits& limits) {
  Reader from(bytes, "its table of values");
  const std::uint64_t count = from.number(4);
  if (count > limits.values)
    refuse(std::to_string(count) + " values, expected at most " + std::to_string(limits.values));
  std::vector<config::TomlValue> values;
  for (std::uint64_t i = 0; i < count; ++i) {
    const auto kind = static_cast<Kind>(from.number(1));
    config::TomlValue entry;
    const std::uint64_t size = from.number(1);
    if (size == 0 || size > kPathBytesMax) refuse("a value's path has " + std::to_string(size) + " bytes");
    entry.path = from.take(size);
    if (!values.empty() && !(values.back().path < entry.path))
      refuse("value " + shown(entry.path) + " occurs twice or out of order");
    entry.value = take_value(from, kind, entry.path);
    values.push_back(std::move(entry));
  }
  from.finish();
  return values;
}

void check_text(std::string_view text, const BundleLimits& limits) {
  if (text.size() > limits.text_bytes)
    refuse("a text of " + std::to_string(text.size()) + " bytes, expected at most " +
           std::to_string(limits.text_bytes));
  const auto strange = [](char c) { return is_control(c) && c != '\n' && c != '\r' && c != '\t'; };
  if (std::any_of(text.begin(), text.end(), strange)) refuse("its text has control characters");
}

const config::TomlValue* find(const std::vector<config::TomlValue>& values, std::string_view path) {
  const auto found = std::find_if(values.begin(), values.end(),
                                  [&](const config::TomlValue& value) { return value.path == path; });
  return found == values.end() ? nullptr : &*found;
}

}  // namespace

SceneWithBundle load_scene_with_bundle(const std::string& name_or_path, const SceneLoading& loading) {
  return make_both(load_description(name_or_path), loading);
}

SceneWithBundle parse_scene_with_bundle(std::string content, const std::string& name) {
  return make_both(config::TomlDocument::parse(std::move(content), name));
}

BundleParts open_bundle(std::string_view bytes, const BundleLimits& limits) {
  if (bytes.size() > limits.bytes)
    refuse(std::to_string(bytes.size()) + " bytes, expected at most " + std::to_string(limits.bytes));
  Reader from(bytes, "it");
  if (from.take(std::min(kMagic.size(), from.left())) != kMagic) refuse("does not begin with \"TLNB\"");
  if (const std::uint64_t form = from.number(4); form != kFormVersion)
    refuse("form " + std::to_string(form) + ", this program reads form " + std::to_string(kFormVersion));
  BundleParts parts;
  parts.physics_version = static_cast<std::uint32_t>(from.number(4));
  const std::uint64_t count = from.number(4);
  if (count != 2 && count != 3) refuse(std::to_string(count) + " entries, expected 2 or 3");
  const std::array<const char*, 3> expected = {kGivenScan, kTextEntry, kValuesEntry};
  std::array<std::string_view, 3> content;
  for (std::size_t i = 3 - count; i < 3; ++i) {
    const std::string_view name = from.take(from.number(1));
    if (name != expected[i]) refuse("entry " + shown(name) + ", expected '" + expected[i] + "'");
    content[i] = from.take(from.number(4));
  }
  from.finish();
  if (count == 3 && content[0].empty()) refuse("its scan is empty");
  check_text(content[1], limits);
  parts.values = take_values(content[2], limits);
  const config::TomlValue* const kind = find(parts.values, "surface.kind");
  const bool scan = kind != nullptr && kind->value == config::TomlValue::Held(std::string("scan"));
  if (scan != (count == 3)) refuse(scan ? "its scan is missing" : "a scan that its surface does not use");
  parts.scan = content[0];
  parts.text = content[1];
  return parts;
}

std::shared_ptr<const Scene> decode_bundle(std::string_view bytes, const BundleLimits& limits) {
  const BundleParts parts = open_bundle(bytes, limits);
  if (parts.physics_version != kPhysicsVersion)
    refuse("of physics version " + std::to_string(parts.physics_version) +
           ", this program computes version " + std::to_string(kPhysicsVersion) + "; update the older one");
  return make_scene(config::TomlDocument::from_values(parts.values, parts.text, kName), {}, &parts.scan);
}

void check_bundle_text(const BundleParts& parts) {
  const auto said = values_without_paths(config::TomlDocument::parse(parts.text, kName), !parts.scan.empty());
  if (said != parts.values) refuse("its text and its numbers differ");
}

}  // namespace telenano::scene

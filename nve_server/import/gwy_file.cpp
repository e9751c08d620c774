#include "telenano/nve_server/import/gwy_file.h"

#include <algorithm>
#include <bit>
#include <charconv>
#include <cstdint>
#include <map>
#include <utility>

namespace telenano::import {
namespace {

constexpr std::string_view kMagic = "GWYP";
// More images than anybody keeps in a file: what is told of them stays readable.
constexpr std::size_t kChannelsMax = 1024;

std::uint32_t uint32_of(std::string_view bytes) noexcept {
  std::uint32_t value = 0;
  for (int i = 3; i >= 0; --i)
    value = value << 8 | static_cast<unsigned char>(bytes[static_cast<std::size_t>(i)]);
  return value;
}

std::int32_t int32_of(std::string_view bytes) noexcept {
  return std::bit_cast<std::int32_t>(uint32_of(bytes));
}

double double_of(std::string_view bytes) noexcept {
  std::uint64_t value = 0;
  for (int i = 7; i >= 0; --i)
    value = value << 8 | static_cast<unsigned char>(bytes[static_cast<std::size_t>(i)]);
  return std::bit_cast<double>(value);
}

/// What is left of an object's data.
class Bytes {
 public:
  explicit Bytes(std::string_view left) : left_(left) {}
  bool empty() const noexcept { return left_.empty(); }
  std::string_view left() const noexcept { return left_; }

  std::optional<std::string_view> take(std::size_t n) noexcept {
    if (n > left_.size()) return std::nullopt;
    const std::string_view taken = left_.substr(0, n);
    left_.remove_prefix(n);
    return taken;
  }
  /// Up to a NUL, which goes too.
  std::optional<std::string_view> text() noexcept {
    const std::size_t end = left_.find('\0');
    if (end == std::string_view::npos) return std::nullopt;
    const std::string_view taken = left_.substr(0, end);
    left_.remove_prefix(end + 1);
    return taken;
  }
  std::optional<std::uint32_t> number() noexcept {
    const auto taken = take(4);
    if (!taken) return std::nullopt;
    return uint32_of(*taken);
  }

 private:
  std::string_view left_;
};

struct Object {
  std::string_view name;
  std::string_view data;
};

std::optional<Object> object_of(Bytes& bytes) noexcept {
  const auto name = bytes.text();
  const auto size = name ? bytes.number() : std::nullopt;
  const auto data = size ? bytes.take(*size) : std::nullopt;
  if (!data) return std::nullopt;
  return Object{*name, *data};
}

/// `value`: the bytes of a number, a text without its NUL, an array's items without their count.
struct Component {
  std::string_view name;
  char type = 0;
  std::string_view value;
  Object object;  // of type 'o'
};

std::size_t size_of(char type) noexcept {
  switch (type) {
    case 'b':
    case 'c':
    case 'C':
      return 1;
    case 'h':
    case 'H':
      return 2;
    case 'i':
    case 'I':
    case 'f':
    case 'F':
      return 4;
    case 'q':
    case 'Q':
    case 'd':
    case 'D':
      return 8;
    default:
      return 0;
  }
}

enum class Next { kComponent, kEnd, kCut, kUnknownType };

Next next_component(Bytes& bytes, Component& out) noexcept {
  if (bytes.empty()) return Next::kEnd;
  const auto name = bytes.text();
  const auto type = name ? bytes.take(1) : std::nullopt;
  if (!type) return Next::kCut;
  out = {*name, type->front(), {}, {}};
  std::optional<std::string_view> value;
  switch (out.type) {
    case 'b':
    case 'c':
    case 'h':
    case 'i':
    case 'f':
    case 'q':
    case 'd':
      value = bytes.take(size_of(out.type));
      break;
    case 'C':
    case 'H':
    case 'I':
    case 'F':
    case 'Q':
    case 'D': {
      // The product of two factors below 2^32 and 8 has room in 64 bits.
      const auto count = bytes.number();
      if (count) value = bytes.take(std::size_t{*count} * size_of(out.type));
      break;
    }
    case 's':
      value = bytes.text();
      break;
    case 'o': {
      const auto object = object_of(bytes);
      if (object) {
        out.object = *object;
        value = object->data;
      }
      break;
    }
    case 'S':
    case 'O': {
      const auto count = bytes.number();
      if (!count) return Next::kCut;
      const std::string_view before = bytes.left();
      // Each takes a byte at least, so that the file's end ends this.
      for (std::uint32_t i = 0; i < *count; ++i) {
        if (out.type == 'S' ? !bytes.text() : !object_of(bytes)) return Next::kCut;
      }
      value = before.substr(0, before.size() - bytes.left().size());
      break;
    }
    default:
      return Next::kUnknownType;
  }
  if (!value) return Next::kCut;
  out.value = *value;
  return Next::kComponent;
}

/// Calls `use(component)` for each; what is wrong, or "".
template <class Use>
std::string for_each_component(std::string_view data, const std::string& of, const Use& use) {
  Bytes bytes(data);
  Component component;
  for (;;) {
    switch (next_component(bytes, component)) {
      case Next::kEnd:
        return {};
      case Next::kComponent:
        use(component);
        break;
      case Next::kCut:
        return "is truncated or damaged: in " + of + " a component" +
               (component.name.empty() ? std::string() : " '" + printable(component.name) + "'") +
               " is longer than what is left of it";
      case Next::kUnknownType:
        return "is damaged: in " + of + " the component '" + printable(component.name) +
               "' has a type that the format does not know";
    }
  }
}

std::string unit_of(const Component& component, const std::string& of, std::string& unit) {
  if (component.object.name != "GwySIUnit") return {};
  return for_each_component(component.object.data, of, [&](const Component& part) {
    if (part.name == "unitstr" && part.type == 's') unit = printable(part.value);
  });
}

std::string field_of(const Object& object, const std::string& key, GwyField& field) {
  std::optional<std::int32_t> columns;
  std::optional<std::int32_t> rows;
  bool has_data = false;
  std::string unit_error;
  std::string error = for_each_component(object.data, key, [&](const Component& part) {
    if (part.type == 'i' && part.name == "xres") columns = int32_of(part.value);
    if (part.type == 'i' && part.name == "yres") rows = int32_of(part.value);
    if (part.type == 'd' && part.name == "xreal") field.width = double_of(part.value);
    if (part.type == 'd' && part.name == "yreal") field.height = double_of(part.value);
    if (part.type == 'D' && part.name == "data") {
      field.data = part.value;
      has_data = true;
    }
    std::string* unit = part.type != 'o'            ? nullptr
                        : part.name == "si_unit_xy" ? &field.unit_xy
                        : part.name == "si_unit_z"  ? &field.unit_z
                                                    : nullptr;
    if (unit == nullptr) return;
    std::string wrong = unit_of(part, key, *unit);
    if (unit_error.empty()) unit_error = std::move(wrong);
  });
  if (error.empty()) error = std::move(unit_error);
  if (!error.empty()) return error;
  if (!columns || !rows || !has_data) return key + " lacks xres, yres or data";
  if (*columns < 1 || *rows < 1 ||
      std::int64_t{*columns} * *rows != static_cast<std::int64_t>(field.count())) {
    return key + " has " + std::to_string(field.count()) +
           " values, expected xres x yres = " + std::to_string(*columns) + " x " + std::to_string(*rows);
  }
  field.columns = *columns;
  field.rows = *rows;
  return {};
}

/// "/N/REST": N and REST.
std::optional<std::pair<int, std::string_view>> numbered(std::string_view key) noexcept {
  if (key.empty() || key.front() != '/') return std::nullopt;
  int number = 0;
  const char* last = key.data() + key.size();
  const auto [end, error] = std::from_chars(key.data() + 1, last, number);
  if (error != std::errc() || number < 0 || end == last || *end != '/') return std::nullopt;
  return std::pair(number, std::string_view(end + 1, static_cast<std::size_t>(last - end - 1)));
}

/// Bytes of the letter in UTF-8 that `text` begins with; 0 where it begins with none that may be printed: a
/// control character (also U+0080 to U+009F, which tell a terminal what to do as ESC does) or no UTF-8
/// (Unicode 15, table 3-7).
std::size_t letter_length(std::string_view text) noexcept {
  const auto byte = [&](std::size_t i) { return i < text.size() ? static_cast<unsigned char>(text[i]) : 0u; };
  const unsigned first = byte(0);
  if (first < 0x80) return first >= 0x20 && first != 0x7f ? 1 : 0;
  const std::size_t length = first >= 0xc2 && first <= 0xdf   ? 2
                             : first >= 0xe0 && first <= 0xef ? 3
                             : first >= 0xf0 && first <= 0xf4 ? 4
                                                              : 0;
  for (std::size_t i = 1; i < length; ++i) {
    if (byte(i) < 0x80 || byte(i) > 0xbf) return 0;
  }
  const bool control = first == 0xc2 && byte(1) < 0xa0;
  const bool overlong = (first == 0xe0 && byte(1) < 0xa0) || (first == 0xf0 && byte(1) < 0x90);
  const bool surrogate = first == 0xed && byte(1) > 0x9f;
  const bool too_far = first == 0xf4 && byte(1) > 0x8f;
  return control || overlong || surrogate || too_far ? 0 : length;
}

struct Found {
  std::optional<Object> data;
  std::optional<Object> mask;
  std::string_view title;
};

}  // namespace

double GwyField::value(std::size_t i) const noexcept {
  return double_of(data.substr(8 * i, 8));
}

bool is_gwy(std::string_view bytes) noexcept {
  return bytes.starts_with(kMagic);
}

std::string printable(std::string_view text, std::size_t longest) {
  std::string line;
  while (!text.empty()) {
    const std::size_t length = letter_length(text);
    const std::string_view letter = length == 0 ? "?" : text.substr(0, length);
    if (line.size() + letter.size() > longest) break;
    line += letter;
    text.remove_prefix(std::max<std::size_t>(length, 1));
  }
  return line;
}

GwyFile read_gwy(std::string_view bytes) {
  GwyFile file;
  const auto refuse = [&](std::string why) {
    file.channels.clear();
    file.error = std::move(why);
    return file;
  };
  if (!is_gwy(bytes)) return refuse("is not a Gwyddion file: expected GWYP at its beginning");
  Bytes left(bytes.substr(kMagic.size()));
  const auto container = object_of(left);
  if (!container) return refuse("is truncated or damaged: its container is longer than the file");
  if (container->name != "GwyContainer") return refuse("is damaged: expected a GwyContainer after GWYP");

  std::map<int, Found> found;
  const std::string error = for_each_component(container->data, "its container", [&](const Component& part) {
    const auto key = numbered(part.name);
    if (!key) return;
    const auto& [number, rest] = *key;
    if (found.size() > kChannelsMax) return;
    const bool field = part.type == 'o' && part.object.name == "GwyDataField";
    if (field && rest == "data") found[number].data = part.object;
    if (field && rest == "mask") found[number].mask = part.object;
    if (part.type == 's' && rest == "data/title") found[number].title = part.value;
  });
  if (!error.empty()) return refuse(error);
  if (found.size() > kChannelsMax)
    return refuse("has more than " + std::to_string(kChannelsMax) + " channels");

  for (const auto& [number, parts] : found) {
    if (!parts.data) continue;
    GwyChannel channel;
    channel.number = number;
    channel.title = printable(parts.title);
    const std::string key = "/" + std::to_string(number);
    if (std::string wrong = field_of(*parts.data, key + "/data", channel.field); !wrong.empty())
      return refuse(std::move(wrong));
    if (parts.mask) {
      channel.mask.emplace();
      if (std::string wrong = field_of(*parts.mask, key + "/mask", *channel.mask); !wrong.empty())
        return refuse(std::move(wrong));
      if (channel.mask->columns != channel.field.columns || channel.mask->rows != channel.field.rows)
        return refuse(key + "/mask is of another size than " + key + "/data");
    }
    file.channels.push_back(std::move(channel));
  }
  return file;
}

}  // namespace telenano::import

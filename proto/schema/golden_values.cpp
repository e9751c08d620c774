// golden_values.h: what the golden datagrams hold, from proto/golden/values.txt, as the messages of messages.h.
#include <algorithm>
#include <charconv>
#include <sstream>
#include <stdexcept>

#include "telenano/proto/schema/schema.h"

namespace telenano::schema {
namespace {

struct Golden {
  std::string name;
  const Message* message = nullptr;
  std::string base;                                          ///< empty: of its own
  std::vector<std::pair<const Field*, std::string>> values;  ///< the text of each, byte strings as 0x.., 0x..
};

[[noreturn]] void refuse(int line, const std::string& why) {
  throw std::runtime_error("values.txt: line " + std::to_string(line) + ": " + why);
}

template <class Number>
bool is_number(std::string text, int base = 10) {
  Number number{};
  const char* end = text.data() + text.size();
  std::from_chars_result result{};
  if constexpr (std::is_floating_point_v<Number>)
    result = std::from_chars(text.data(), end, number);
  else
    result = std::from_chars(text.data(), end, number, base);
  return result.ec == std::errc{} && result.ptr == end;
}

bool fits(FieldType type, const std::string& text) {
  if (type == FieldType::kDouble) return is_number<double>(text);
  const bool hexadecimal = text.rfind("0x", 0) == 0;
  const std::string digits = hexadecimal ? text.substr(2) : text;
  const int base = hexadecimal ? 16 : 10;
  return type == FieldType::kFixed32 ? is_number<std::uint32_t>(digits, base)
                                     : is_number<std::uint64_t>(digits, base);
}

/// "flakes" in quotes, or pairs of hexadecimal digits, as numbers of C++.
std::string byte_list(int line, const std::string& text) {
  std::ostringstream out;
  if (text.size() >= 2 && text.front() == '"' && text.back() == '"') {
    for (std::size_t i = 1; i + 1 < text.size(); ++i)
      out << static_cast<int>(static_cast<unsigned char>(text[i])) << ", ";
    return out.str();
  }
  std::istringstream in(text);
  std::string word;
  if (!(in >> word) || word != "hex") refuse(line, "bytes are \"text\" or: hex 0f 1e ...");
  while (in >> word) {
    if (word.size() != 2 || !is_number<unsigned>(word, 16)) refuse(line, "'" + word + "' is not two digits");
    out << "0x" << word << ", ";
  }
  return out.str();
}

/// The lines of the table without its comments, each with its number; lines that begin with a space belong to the one before.
std::vector<std::pair<int, std::string>> read_lines(const std::string& text) {
  std::vector<std::pair<int, std::string>> lines;
  std::istringstream in(text);
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    if (line.empty() || line[0] == '#') continue;
    if (line[0] != ' ')
      lines.emplace_back(number, line);
    else if (lines.empty())
      refuse(number, "it goes on with nothing");
    else
      lines.back().second += line;
  }
  return lines;
}

Golden read_heading(const Schema& schema, const std::vector<Golden>& before, int line,
                    const std::string& text) {
  Golden golden;
  const std::size_t end = text.find(']');
  if (end == std::string::npos) refuse(line, "a heading is [name] Message, or [name] other + FEATURE ...");
  golden.name = text.substr(1, end - 1);
  std::istringstream in(text.substr(end + 1));
  std::string of, word;
  in >> of;
  for (const Message& message : schema.messages)
    if (message.name == of) golden.message = &message;
  for (const Golden& other : before) {
    if (other.name == golden.name) refuse(line, "'" + golden.name + "' stands there twice");
    if (other.name != of) continue;
    golden.base = of;
    golden.message = other.message;
  }
  if (golden.message == nullptr) refuse(line, "there is no message and no datagram '" + of + "' before it");
  while (in >> word) {
    wire::Feature feature{};
    if (word != "+" && !wire::Feature_Parse(word, &feature)) refuse(line, "there is no feature " + word);
  }
  return golden;
}

std::vector<Golden> read_table(const Schema& schema, const std::string& text) {
  std::vector<Golden> all;
  for (const auto& [line, words] : read_lines(text)) {
    if (words[0] == '[') {
      all.push_back(read_heading(schema, all, line, words));
      continue;
    }
    const std::size_t colon = words.find(": ");
    if (all.empty() || colon == std::string::npos) refuse(line, "after a heading, a line is field: value");
    Golden& golden = all.back();
    const std::string name = words.substr(0, colon), value = words.substr(colon + 2);
    const auto& fields = golden.message->fields;
    const auto field =
        std::find_if(fields.begin(), fields.end(), [&](const Field& f) { return f.name == name; });
    if (field == fields.end()) refuse(line, golden.message->name + " has no field " + name);
    for (const auto& [other, text_of] : golden.values)
      if (other == &*field) refuse(line, name + " stands there twice");
    if (!field->is_bytes() && !fits(field->type, value))
      refuse(line, name + ": '" + value + "' is no " + type_name(field->type));
    golden.values.emplace_back(&*field, field->is_bytes() ? byte_list(line, value) : value);
  }
  return all;
}

std::string make_function(const Golden& golden) {
  std::string out = "  static " + golden.message->name + " make_" + golden.name + "() {\n    " +
                    golden.message->name + " m" +
                    (golden.base.empty() ? "" : " = make_" + golden.base + "()") + ";\n";
  for (const auto& [field, value] : golden.values) {
    if (field->is_bytes()) {
      out += "    set_bytes(m, {" + value + "});  // " + field->name + "\n";
      continue;
    }
    if (field->member.empty()) continue;
    const std::string suffix = field->type == FieldType::kDouble ? "" : "u";
    out += "    m." + field->member + " = static_cast<std::remove_reference_t<decltype(m." + field->member +
           ")>>(" + value + suffix + ");\n";
  }
  return out + "    return m;\n  }\n";
}

std::string same_function(const Message& message) {
  std::string out = "inline bool same(const " + message.name + "& a, const " + message.name +
                    "& b) {\n  return same_bytes(a, b)";
  for (const Field& field : message.fields)
    if (!field.member.empty()) out += " &&\n         a." + field.member + " == b." + field.member;
  return out + ";\n}\n";
}

}  // namespace

std::string golden_header(const Schema& schema, const std::string& table) {
  const std::vector<Golden> all = read_table(schema, table);
  std::string out =
      "// Made by telenano-schema of proto/golden/values.txt: change it there.\n#pragma once\n\n"
      "#include <array>\n#include <type_traits>\n\n#include \"tests/unit/link/golden_bytes.h\"\n\nnamespace "
      "telenano::link {\n\n"
      "struct GoldenValues {\n";
  for (const Golden& golden : all) out += make_function(golden);
  for (const Golden& golden : all)
    out += "  " + golden.message->name + " " + golden.name + " = make_" + golden.name + "();\n";
  out +=
      "\n  /// visit(message) of the one with this place in kGoldenNames.\n  template <class Visit>\n"
      "  auto with(std::size_t which, Visit&& visit) const {\n    switch (which) {\n";
  for (std::size_t i = 0; i < all.size(); ++i) {
    out += "      case " + std::to_string(i) + ":\n        return visit(" + all[i].name + ");\n";
  }
  out += "    }\n    return visit(" + all.front().name + ");\n  }\n};\n\n";
  const std::string count = std::to_string(all.size());
  out += "inline constexpr std::array<const char*, " + count + "> kGoldenNames = {";
  for (const Golden& golden : all) out += "\n    \"" + golden.name + "\",";
  out += "};\ninline constexpr std::array<MessageType, " + count + "> kGoldenTypes = {";
  for (const Golden& golden : all) out += "\n    MessageType::k" + golden.message->name + ",";
  out += "};\n\n";
  for (const Message& message : schema.messages) out += same_function(message) + "\n";
  return out + "}  // namespace telenano::link\n";
}

}  // namespace telenano::schema

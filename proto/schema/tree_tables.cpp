// What is kept in the tree: the tables of PROTOCOL.md and of telenano.lua.
#include <algorithm>

#include "telenano/proto/schema/schema.h"

namespace telenano::schema {
namespace {

/// port control: of the enum's PORT_CONTROL.
std::string feature_text(wire::Feature feature) {
  std::string words = wire::Feature_Name(feature);
  for (char& c : words) c = static_cast<char>(c == '_' ? ' ' : std::tolower(c));
  return words;
}

/// Fields that share one row: a vector, or fields of which only the first has a meaning.
std::size_t row_end(const std::vector<Field>& fields, std::size_t begin) {
  if (fields[begin].axis == 0) return begin + 3;
  std::size_t end = begin + 1;
  while (end < fields.size() && fields[end].meaning.empty() && fields[end].axis < 0) ++end;
  return end;
}

std::string row(const std::vector<Field>& fields, std::size_t begin, std::size_t end) {
  const Field& first = fields[begin];
  std::string numbers = std::to_string(first.number), names = first.name;
  if (end - begin == 2) numbers += ", " + std::to_string(fields[end - 1].number);
  if (end - begin > 2) numbers += "–" + std::to_string(fields[end - 1].number);
  if (first.axis == 0) {
    names = vector_name(first);
  } else {
    for (std::size_t i = begin + 1; i < end; ++i) names += ", " + fields[i].name;
  }
  return "| " + numbers + " | " + names + " | " + type_name(first.type) + " | " + first.meaning + " |\n";
}

/// Header and every field, byte strings not counted.
std::size_t longest_datagram(const Message& message) {
  std::size_t bytes = 8;
  for (const Field& field : message.fields)
    if (!field.is_bytes())
      bytes += (field.number < 16 ? 1u : 2u) + (field.type == FieldType::kFixed32 ? 4u : 8u);
  return bytes;
}

/// Numbers of a message's fields with a feature: 15–22, 31.
std::string numbers_of(const Message& message, wire::Feature feature) {
  std::string out;
  for (std::size_t begin = 0; begin < message.fields.size();) {
    std::size_t end = begin;
    while (end < message.fields.size() && message.fields[end].feature == feature &&
           message.fields[end].number == message.fields[begin].number + (end - begin))
      ++end;
    if (end > begin) {
      out += (out.empty() ? "" : ", ") + std::to_string(message.fields[begin].number);
      if (end - begin > 1) out += "–" + std::to_string(message.fields[end - 1].number);
    }
    begin = std::max(end, begin + 1);
  }
  return out;
}

char dissector_kind(const Field& field) {
  if (field.is_bytes()) return 'b';
  if (field.type == FieldType::kDouble) return 'd';
  if (field.hexadecimal) return 'x';
  return field.type == FieldType::kFixed32 ? 'i' : 'q';
}

/// `words` one after the other, in lines of at most 120 characters, indented by four.
std::string wrapped(const std::vector<std::string>& words) {
  std::string out, line = "   ";
  for (const std::string& word : words) {
    if (line.size() + 1 + word.size() > 120) {
      out += line + "\n";
      line = "   ";
    }
    line += " " + word;
  }
  return out + line;
}

}  // namespace

std::string document_table(const Message& message) {
  // Blank lines round it: the marks are HTML to whoever shows the document.
  std::string out = "\n| # | field | type | meaning, range |\n|---|---|---|---|\n";
  std::optional<wire::Feature> feature;
  for (std::size_t begin = 0; begin < message.fields.size();) {
    const Field& first = message.fields[begin];
    if (first.feature && first.feature != feature)
      out += "| | *with " + feature_text(*first.feature) + " (feature bit " + std::to_string(*first.feature) +
             "):* | | |\n";
    feature = first.feature;
    const std::size_t end = row_end(message.fields, begin);
    out += row(message.fields, begin, end);
    begin = end;
  }
  out += "\n";
  if (message.name == "Command" || message.name == "Reply")
    out += "At most " + std::to_string(longest_datagram(message)) + " bytes" +
           (std::any_of(message.fields.begin(), message.fields.end(),
                        [](const Field& field) { return field.is_bytes(); })
                ? " without byte strings"
                : "") +
           ".\n\n";
  return out;
}

std::string features_table(const Schema& schema) {
  std::string out = "\n| bit | feature | fields |\n|---|---|---|\n";
  for (const FeatureText& text : schema.features) {
    std::string fields;
    for (const Message& message : schema.messages) {
      const std::string numbers = numbers_of(message, text.feature);
      if (!numbers.empty()) fields += (fields.empty() ? "" : "; ") + message.name + " " + numbers;
    }
    if (!text.besides.empty()) fields += (fields.empty() ? "" : "; ") + text.besides;
    out += "| " + std::to_string(text.feature) + " | " + feature_text(text.feature) +
           (text.condition.empty() ? "" : ": " + text.condition) + " | " + fields + " |\n";
  }
  return out + "\n";
}

std::string dissector_tables(const Schema& schema) {
  std::vector<std::string> types;
  for (const Message& message : schema.messages)
    types.push_back("[" + std::to_string(message.type) + "] = \"" + message.name + "\",");
  std::string out = "local types = {\n" + wrapped(types) + "\n}\n";
  out += "local values = {\n";
  for (const ValueNames& names : schema.value_names) {
    std::vector<std::string> words;
    for (const Value& value : names.values)
      words.push_back("[" + std::to_string(value.number) + "] = \"" + value.shown + "\",");
    out += "  " + names.name + " = {\n" + wrapped(words) + "\n  },\n";
  }
  out += "}\nlocal messages = {\n";
  for (const Message& message : schema.messages) {
    std::vector<std::string> words;
    for (const Field& field : message.fields) {
      words.push_back("{ " + std::to_string(field.number) + ", \"" + field.name + "\", \"" +
                      dissector_kind(field) + "\"" +
                      (field.values.empty() ? "" : ", values." + field.values) + " },");
    }
    out += "  [" + std::to_string(message.type) + "] = {  -- " + message.name + "\n" + wrapped(words) +
           "\n  },\n";
  }
  return out + "}\n";
}

}  // namespace telenano::schema

// The codec's two headers: wire_fields.h (visitors, lists by type, features; no Protobuf) and wire_messages.h (between
// the structs of messages.h and Protobuf's classes); and the recording's, reply_columns.h.
#include <algorithm>
#include <functional>
#include <map>

#include "telenano/proto/schema/schema.h"

namespace telenano::schema {
namespace {

const std::string kMade = "// Made by telenano-schema of proto/telenano.proto: change it there.\n";

/// PORT_CONTROL: PortControl. recent_commands: RecentCommands.
std::string camel(const std::string& name) {
  std::string out;
  bool first = true;
  for (const char c : name) {
    if (c == '_') {
      first = true;
      continue;
    }
    out += static_cast<char>(first ? std::toupper(c) : std::tolower(c));
    first = false;
  }
  return out;
}

std::string feature_constant(wire::Feature feature) {
  return "kFeature" + camel(wire::Feature_Name(feature));
}

bool is_streamed(const Message& message) {
  return message.name == "Command" || message.name == "Reply";
}

/// These come in the usual form only: fields in rising order, zeros left out. Protobuf never sees them.
bool comes_in_order(const Message& message) {
  return message.name.rfind("Snapshot", 0) == 0 || message.name.rfind("SceneList", 0) == 0 ||
         message.name == "SceneSwitch";
}

bool has_visitor(const Message& message) {
  return is_streamed(message) || comes_in_order(message);
}

/// Whether a field goes on with the run that the one before it is in.
bool goes_on(const Field& before, const Field& field) {
  if (field.axis > 0) return true;
  return field.axis < 0 && before.axis < 0 && !field.together.empty() && field.together == before.together;
}

using Filter = std::function<bool(const Field&)>;

std::string visits(const Message& message, const Filter& wanted) {
  std::vector<const Field*> fields;
  for (const Field& field : message.fields)
    if (wanted(field)) fields.push_back(&field);
  std::string out;
  for (std::size_t begin = 0; begin < fields.size();) {
    std::size_t end = begin + 1;
    while (end < fields.size() && goes_on(*fields[end - 1], *fields[end])) ++end;
    const bool run = end - begin > 1;
    if (run) out += "  visit.run([&](auto& in) TELENANO_INLINED {\n";
    for (; begin < end; ++begin) {
      const Field& field = *fields[begin];
      out += (run ? "    in" : "  visit") + std::string(".template operator()<") +
             std::to_string(field.number) + ">(m." + field.member + ");\n";
    }
    if (run) out += "  });\n";
  }
  return out;
}

std::string visitor(const Message& message, const std::string& name, const Filter& wanted) {
  return "template <class Message, class Visit>\nrequires std::is_same_v<std::remove_const_t<Message>, " +
         message.name + "> TELENANO_INLINE void " + name + "(Message& m, Visit& visit) noexcept {\n" +
         visits(message, wanted) + "}\n\n";
}

std::string features_used(const Message& message) {
  std::map<wire::Feature, std::vector<const Field*>> by_feature;
  for (const Field& field : message.fields)
    if (field.feature && !field.member.empty()) by_feature[*field.feature].push_back(&field);
  if (by_feature.empty()) return "";
  std::string out = "inline std::uint64_t features_used(const " + message.name +
                    "& m) noexcept {\n  std::uint64_t bits = 0;\n";
  for (const auto& [feature, fields] : by_feature) {
    out += "  {\n    Nonzero any;\n";
    for (const Field* field : fields) out += "    any(m." + field->member + ");\n";
    out += "    if (any.is) bits |= " + feature_constant(feature) + ";\n  }\n";
  }
  return out + "  return bits;\n}\n\n";
}

const char* wire_type(FieldType type) {
  switch (type) {
    case FieldType::kFixed32:
      return "kFixed32";
    case FieldType::kFixed64:
    case FieldType::kDouble:
      return "kFixed64";
    case FieldType::kBytes:
      break;
  }
  return "kByteString";
}

std::string list(const Message& message) {
  std::string out = "constexpr FieldList k" + message.name + "Fields = [] {\n  FieldList list{};\n";
  for (const Field& field : message.fields)
    out += "  list[" + std::to_string(field.number) + "] = " + wire_type(field.type) + ";\n";
  return out + "  return list;\n}();\n";
}

}  // namespace

std::string visitors_header(const Schema& schema) {
  std::string out = kMade + R"(#pragma once

#include <array>
#include <cstdint>
#include <type_traits>

#include "telenano/common/link/messages.h"

namespace telenano::link {

// Field by field, `visit.template operator()<NUMBER>(member)`, in rising order. Fields behind feature bits stand apart:
// most sessions have none. `visit.run(...)` around fields says that they are mostly there, or not there, together. A
// visitor writes bytes, and bytes may lie anywhere, also where it keeps its own place: unless all is one function, that
// place goes through memory at each field, and each field waits for the one before. So all of it is inlined.
#define TELENANO_INLINED __attribute__((always_inline))
#define TELENANO_INLINE TELENANO_INLINED inline

)";
  for (const Message& message : schema.messages) {
    if (!has_visitor(message)) continue;
    const auto named = [](const Field& field) { return !field.member.empty(); };
    out += visitor(message, "visit_fields", [&](const Field& field) {
      return named(field) && !(is_streamed(message) && field.feature);
    });
    if (is_streamed(message))
      out += visitor(message, "visit_feature_fields",
                     [&](const Field& field) { return named(field) && field.feature; });
  }
  out += R"(#undef TELENANO_INLINE
#undef TELENANO_INLINED

struct Nonzero {
  bool is = false;
  template <class Value>
  void operator()(const Value& value) noexcept {
    is = is || value != Value{};
  }
};

/// Bits of the features of which a field differs from zero; byte strings are not looked at.
)";
  for (const Message& message : schema.messages) out += features_used(message);

  std::uint32_t highest = 0;
  for (const Message& message : schema.messages)
    for (const Field& field : message.fields) highest = std::max(highest, field.number);
  out +=
      "// Wire types of Protobuf by field number; 0: no such field.\nconstexpr std::uint8_t kNoField = 0, "
      "kFixed64 = 1, kByteString = 2, kFixed32 = 5;\n"
      "constexpr std::size_t kMaxFields = " +
      std::to_string(highest) + ";\nusing FieldList = std::array<std::uint8_t, kMaxFields + 1>;\n\n";
  for (const Message& message : schema.messages) out += list(message);
  out += "constexpr std::array<FieldList, " + std::to_string(schema.messages.size() + 1) +
         "> kFieldLists = {FieldList{}";
  for (const Message& message : schema.messages) out += ",\n    k" + message.name + "Fields";
  out += "};  // by message type\n\n";
  for (const Message& message : schema.messages) {
    out += "static_assert(static_cast<int>(MessageType::k" + message.name +
           ") == " + std::to_string(message.type) + ");\n";
    for (const Field& field : message.fields) {
      if (field.is_bytes())
        out += "constexpr std::uint32_t k" + message.name + camel(field.name) + " = " +
               std::to_string(field.number) + ";\n";
    }
  }
  std::string all;
  for (int bit = wire::Feature_MIN; bit <= wire::Feature_MAX; ++bit) {
    if (!wire::Feature_IsValid(bit)) continue;
    const std::string constant = feature_constant(static_cast<wire::Feature>(bit));
    out += "static_assert(" + constant + " == std::uint64_t{1} << " + std::to_string(bit) + ");\n";
    all += (all.empty() ? "" : " | ") + constant;
  }
  out += "static_assert(kKnownFeatures == (" + all + "));\n";
  for (const ValueNames& names : schema.value_names) {
    for (const Value& value : names.values)
      out += "static_assert(static_cast<std::uint32_t>(" + value.enumerator +
             ") == " + std::to_string(value.number) + ");\n";
  }
  return out + "\n}  // namespace telenano::link\n";
}

std::string messages_header(const Schema& schema) {
  std::string out = kMade + R"(#pragma once

#include <cstdint>

#include "proto/telenano.pb.h"
#include "telenano/common/link/messages.h"

namespace telenano::link {

)";
  for (const Message& message : schema.messages) {
    if (comes_in_order(message)) continue;
    std::string to =
        "inline void to_wire(const " + message.name + "& m, wire::" + message.name + "& w) noexcept {\n";
    std::string from =
        "inline void from_wire(const wire::" + message.name + "& w, " + message.name + "& m) noexcept {\n";
    for (const Field& field : message.fields) {
      if (field.member.empty()) continue;
      const std::string type = field.type == FieldType::kFixed32   ? "std::uint32_t"
                               : field.type == FieldType::kFixed64 ? "std::uint64_t"
                                                                   : "double";
      to += "  w.set_" + field.name + "(static_cast<" + type + ">(m." + field.member + "));\n";
      from += "  m." + field.member + " = static_cast<std::remove_reference_t<decltype(m." + field.member +
              ")>>(w." + field.name + "());\n";
    }
    out += to + "}\n\n" + from + "}\n\n";
  }
  return out + "}  // namespace telenano::link\n";
}

std::string columns_header(const Schema& schema) {
  std::string out = kMade + R"(#pragma once

// F(column, unit, description, member of Reply), a line for each field of Reply that recordings keep.
#define TELENANO_REPLY_COLUMNS(F))";
  for (const Message& message : schema.messages) {
    for (const Field& field : message.fields) {
      if (!field.column) continue;
      // A vector's member ends in its axis, .x().
      const std::string member =
          field.axis == 0 ? field.member.substr(0, field.member.size() - 4) : field.member;
      out += " \\\n  F(" + field.column->name + ", \"" + field.column->unit + "\", \"" +
             field.column->description + "\", " + member + ")";
    }
  }
  return out + "\n";
}

}  // namespace telenano::schema

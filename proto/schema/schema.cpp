#include "telenano/proto/schema/schema.h"

#include <google/protobuf/descriptor.pb.h>

#include <algorithm>
#include <set>
#include <stdexcept>

namespace telenano::schema {
namespace {

using google::protobuf::DescriptorProto;
using google::protobuf::EnumDescriptorProto;
using google::protobuf::FieldDescriptorProto;

[[noreturn]] void refuse(const std::string& where, const std::string& why) {
  throw std::runtime_error("telenano.proto: " + where + ": " + why);
}

FieldType read_type(const std::string& where, const FieldDescriptorProto& field) {
  switch (field.type()) {
    case FieldDescriptorProto::TYPE_FIXED32:
      return FieldType::kFixed32;
    case FieldDescriptorProto::TYPE_FIXED64:
      return FieldType::kFixed64;
    case FieldDescriptorProto::TYPE_DOUBLE:
      return FieldType::kDouble;
    case FieldDescriptorProto::TYPE_BYTES:
      return FieldType::kBytes;
    default:
      refuse(where, "only fixed32, fixed64, double and bytes are taken");
  }
}

/// Place of the axis letter in tip_pos_w_x_nm: between underscores, or at the end behind one.
std::size_t axis_at(const std::string& name, char axis) {
  for (std::size_t at = 0; (at = name.find(std::string("_") + axis, at)) != std::string::npos; ++at)
    if (at + 2 == name.size() || name[at + 2] == '_') return at + 1;
  return std::string::npos;
}

std::string with_axis(const std::string& name, char axis) {
  std::string other = name;
  const std::size_t at = axis_at(name, 'x');
  if (at != std::string::npos) other[at] = axis;
  return other;
}

/// tip_pos_w_x_nm: tip_pos_w_nm.
std::string without_axis(const std::string& name) {
  std::string other = name;
  return other.erase(axis_at(name, 'x') - 1, 2);
}

Column read_column(const std::string& where, const std::string& message, const wire::Column& from) {
  if (message != "Reply") refuse(where, "column: recordings keep fields of Reply only");
  const Column column{from.name(), from.unit(), from.description()};
  const bool named = !column.name.empty() && std::all_of(column.name.begin(), column.name.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_';
  });
  if (!named) refuse(where, "column: its name is of a-z, 0-9 and _");
  for (const std::string& text : {column.unit, column.description}) {
    const bool plain = !text.empty() && std::all_of(text.begin(), text.end(), [](char c) {
      return c >= ' ' && c <= '~' && c != '"' && c != '\\';
    });
    if (!plain) refuse(where, "column: unit and description are plain ASCII, without quotes");
  }
  return column;
}

Field read_field(const std::string& message, const FieldDescriptorProto& from) {
  const auto& options = from.options();
  Field field;
  field.name = from.name();
  field.number = static_cast<std::uint32_t>(from.number());
  const std::string where = message + "." + field.name;
  field.type = read_type(where, from);
  // The codec's tables and its set of the fields that were met are that large.
  if (field.number > 63) refuse(where, "numbers go to 63");
  field.meaning = options.GetExtension(wire::meaning);
  if (field.meaning.find_first_of("|\n") != std::string::npos)
    refuse(where, "meaning: no | and no line's end");
  field.member = options.GetExtension(wire::member);
  field.together = options.GetExtension(wire::together);
  field.values = options.GetExtension(wire::values);
  field.hexadecimal = options.GetExtension(wire::hexadecimal);
  if (options.HasExtension(wire::feature)) field.feature = options.GetExtension(wire::feature);
  if (options.HasExtension(wire::column))
    field.column = read_column(where, message, options.GetExtension(wire::column));
  return field;
}

/// Three doubles in a row named for the axes are a vector; what is said of the x holds for all.
void find_vectors(std::vector<Field>& fields) {
  for (std::size_t i = 0; i < fields.size(); ++i) {
    Field& x = fields[i];
    const bool named = x.type == FieldType::kDouble && axis_at(x.name, 'x') != std::string::npos;
    const bool vector = named && i + 2 < fields.size() && fields[i + 1].name == with_axis(x.name, 'y') &&
                        fields[i + 2].name == with_axis(x.name, 'z') && fields[i + 2].number == x.number + 2;
    if (!vector) {
      if (x.member.empty()) x.member = x.name;
      if (x.member == "-" || x.is_bytes()) x.member.clear();
      continue;
    }
    const std::string member = x.member.empty() ? without_axis(x.name) : x.member;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      Field& part = fields[i + axis];
      part.axis = static_cast<int>(axis);
      part.member = member + "." + "xyz"[axis] + "()";
      part.feature = x.feature;
    }
    i += 2;
  }
}

Message read_message(const DescriptorProto& from) {
  Message message;
  message.name = from.name();
  message.type = from.options().GetExtension(wire::type);
  if (message.type == 0) refuse(message.name, "it has no type");
  for (const FieldDescriptorProto& field : from.field())
    message.fields.push_back(read_field(message.name, field));
  std::sort(message.fields.begin(), message.fields.end(),
            [](const Field& a, const Field& b) { return a.number < b.number; });
  if (message.fields.empty() || message.fields.front().meaning.empty())
    refuse(message.name, "its first field needs a meaning");
  find_vectors(message.fields);
  return message;
}

ValueNames read_values(const EnumDescriptorProto& from) {
  ValueNames names{from.name(), from.options().GetExtension(wire::mirrors), {}};
  for (const auto& value : from.value()) {
    if (!value.options().HasExtension(wire::shown))
      continue;  // proto3 wants a zero, the protocol may not have it
    names.values.push_back({static_cast<std::uint32_t>(value.number()), value.name(),
                            value.options().GetExtension(wire::shown),
                            value.options().GetExtension(wire::enumerator)});
  }
  return names;
}

}  // namespace

Schema read_schema(const google::protobuf::FileDescriptorProto& file) {
  Schema schema;
  for (int bit = wire::Feature_MIN; bit <= wire::Feature_MAX; ++bit) {
    const auto* value = wire::Feature_descriptor()->FindValueByNumber(bit);
    if (value == nullptr) continue;
    schema.features.push_back({static_cast<wire::Feature>(bit),
                               value->options().GetExtension(wire::condition),
                               value->options().GetExtension(wire::besides)});
  }
  for (const EnumDescriptorProto& names : file.enum_type()) schema.value_names.push_back(read_values(names));
  for (const DescriptorProto& message : file.message_type()) schema.messages.push_back(read_message(message));
  std::sort(schema.messages.begin(), schema.messages.end(),
            [](const Message& a, const Message& b) { return a.type < b.type; });
  for (std::size_t i = 0; i < schema.messages.size(); ++i) {
    const Message& message = schema.messages[i];
    if (message.type != i + 1) refuse(message.name, "types go from 1, without a gap");
    for (const Field& field : message.fields) {
      const bool known = std::any_of(schema.value_names.begin(), schema.value_names.end(),
                                     [&](const ValueNames& names) { return names.name == field.values; });
      if (!field.values.empty() && !known)
        refuse(message.name + "." + field.name, "there is no enum " + field.values);
    }
  }
  return schema;
}

std::string vector_name(const Field& x) {
  std::string name = x.name;
  return name.replace(axis_at(name, 'x'), 1, "{x,y,z}");
}

const char* type_name(FieldType type) {
  switch (type) {
    case FieldType::kFixed32:
      return "fixed32";
    case FieldType::kFixed64:
      return "fixed64";
    case FieldType::kDouble:
      return "double";
    case FieldType::kBytes:
      break;
  }
  return "bytes";
}

}  // namespace telenano::schema

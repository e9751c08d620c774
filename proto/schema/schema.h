#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "telenano_options.pb.h"

namespace google::protobuf {
class FileDescriptorProto;
}

/// What telenano.proto says, as telenano-schema writes it out again: messages with their fields in rising order,
/// and the names of values.
namespace telenano::schema {

enum class FieldType : std::uint8_t { kFixed32, kFixed64, kDouble, kBytes };

/// A column of recordings.
struct Column {
  std::string name, unit, description;
};

struct Field {
  std::string name;
  std::uint32_t number = 0;
  FieldType type = FieldType::kFixed32;
  std::string meaning;   ///< empty: it shares the row of the field before it
  std::string member;    ///< in messages.h; a vector's with .x(), .y(), .z(); empty: set by hand
  std::string together;  ///< fields with the same word in a row are a run; empty: none
  std::string values;    ///< name of an enum; empty: none
  std::optional<wire::Feature> feature;
  std::optional<Column> column;  ///< a vector's stands with its x
  bool hexadecimal = false;
  int axis = -1;  ///< 0, 1, 2: a component of a vector

  bool is_bytes() const { return type == FieldType::kBytes; }
};

struct Message {
  std::string name;
  std::uint32_t type = 0;
  std::vector<Field> fields;
};

struct Value {
  std::uint32_t number = 0;
  std::string name, shown, enumerator;
};

struct ValueNames {
  std::string name, mirrors;
  std::vector<Value> values;
};

struct FeatureText {
  wire::Feature feature{};
  std::string condition;  ///< when it is granted; empty: to whoever asks
  std::string besides;    ///< what it comes with besides its fields; empty: nothing
};

struct Schema {
  std::vector<Message> messages;  ///< in the order of their types
  std::vector<ValueNames> value_names;
  std::vector<FeatureText> features;  ///< in the order of their bits
};

/// Throws std::runtime_error with a line that names the message and the field, where telenano.proto is not as the
/// rules of telenano_options.proto say.
Schema read_schema(const google::protobuf::FileDescriptorProto& file);

std::string vector_name(const Field& x);  ///< tip_pos_w_x_nm: tip_pos_w_{x,y,z}_nm
const char* type_name(FieldType type);

// What is made of it.
std::string visitors_header(const Schema& schema);   ///< wire_fields.h
std::string messages_header(const Schema& schema);   ///< wire_messages.h
std::string columns_header(const Schema& schema);    ///< reply_columns.h
std::string document_table(const Message& message);  ///< the table of PROTOCOL.md
std::string dissector_tables(const Schema& schema);  ///< of telenano.lua
std::string features_table(const Schema& schema);    ///< of PROTOCOL.md, section 9
/// golden_values.h, from the text of golden/values.txt; throws with a line that names the line.
std::string golden_header(const Schema& schema, const std::string& table);

}  // namespace telenano::schema

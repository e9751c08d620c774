// telenano-schema: from telenano.proto, as protoc has read it, to what else lists the protocol's fields. It runs when the
// project is built, so it takes its words in this order only and says what is wrong in a line.
#include <google/protobuf/descriptor.pb.h>

#include <fstream>
#include <iostream>
#include <sstream>
#include <stdexcept>

#include "telenano/proto/schema/schema.h"

namespace telenano::schema {
namespace {

constexpr const char* kUsage =
    "usage: telenano-schema DESCRIPTORS headers OUT_FOLDER   the codec's wire_fields.h and wire_messages.h, "
    "the "
    "recording's reply_columns.h\n"
    "       telenano-schema DESCRIPTORS golden VALUES OUT    golden/values.txt as a header for the tests\n"
    "       telenano-schema DESCRIPTORS renew PROTO_FOLDER   the tables of PROTOCOL.md and telenano.lua, in "
    "their place\n"
    "       telenano-schema DESCRIPTORS check PROTO_FOLDER   exit status 1 where a table is not what renew "
    "would write\n"
    "DESCRIPTORS: of protoc --descriptor_set_out, telenano.proto last\n";

std::string read_file(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw std::runtime_error(path + ": cannot be read");
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

void write_file(const std::string& path, const std::string& text) {
  std::ofstream out(path, std::ios::binary);
  out << text;
  out.close();
  if (!out) throw std::runtime_error(path + ": cannot be written");
}

Schema load(const std::string& path) {
  google::protobuf::FileDescriptorSet files;
  if (!files.ParseFromString(read_file(path)) || files.file_size() == 0)
    throw std::runtime_error(path + ": not descriptors");
  return read_schema(files.file(files.file_size() - 1));
}

/// Puts `made` between two lines of `text`, of which the first begins with `begin`.
std::string replaced(const std::string& path, const std::string& text, const std::string& begin,
                     const std::string& end, const std::string& made) {
  const std::size_t mark = text.find("\n" + begin + "\n");
  const std::size_t from = mark + begin.size() + 2;
  const std::size_t to = mark == std::string::npos ? mark : text.find(end + "\n", from);
  if (to == std::string::npos)
    throw std::runtime_error(path + ": there are no lines '" + begin + "' and '" + end + "'");
  return text.substr(0, from) + made + text.substr(to);
}

/// Both files as they should be; true if they are.
bool tables(const Schema& schema, const std::string& folder, bool write) {
  const std::string document = folder + "/PROTOCOL.md", dissector = folder + "/telenano.lua";
  const std::string old_text = read_file(document), old_lua = read_file(dissector);
  std::string text =
      replaced(document, old_text, "<!-- features -->", "<!-- end -->", features_table(schema));
  for (const Message& message : schema.messages)
    text = replaced(document, text, "<!-- fields: " + message.name + " -->", "<!-- end -->",
                    document_table(message));
  const std::string lua =
      replaced(dissector, old_lua, "-- Made by telenano-schema of telenano.proto: change it there.",
               "-- End of what is made.", dissector_tables(schema));
  if (write && text != old_text) write_file(document, text);
  if (write && lua != old_lua) write_file(dissector, lua);
  return text == old_text && lua == old_lua;
}

int run(int argc, char** argv) {
  const bool golden = argc == 5 && std::string(argv[2]) == "golden";
  if (argc != 4 && !golden) {
    std::cerr << kUsage;
    return 2;
  }
  const Schema schema = load(argv[1]);
  if (golden) {
    write_file(argv[4], golden_header(schema, read_file(argv[3])));
    return 0;
  }
  const std::string what = argv[2], folder = argv[3];
  if (what == "headers") {
    write_file(folder + "/wire_fields.h", visitors_header(schema));
    write_file(folder + "/wire_messages.h", messages_header(schema));
    write_file(folder + "/reply_columns.h", columns_header(schema));
    return 0;
  }
  if (what == "renew" || what == "check") {
    if (tables(schema, folder, what == "renew") || what == "renew") return 0;
    std::cerr << "the tables of PROTOCOL.md or telenano.lua are not those of telenano.proto: cmake --build "
                 "build/release --target schema\n";
    return 1;
  }
  std::cerr << kUsage;
  return 2;
}

}  // namespace
}  // namespace telenano::schema

int main(int argc, char** argv) try {
  return telenano::schema::run(argc, argv);
} catch (const std::exception& error) {
  std::cerr << "telenano-schema: " << error.what() << '\n';
  return 2;
}

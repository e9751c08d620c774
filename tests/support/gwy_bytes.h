#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

/// Gwyddion's native format as its documentation has it, written without the reader's help: objects and
/// components as bytes. The tests run on little-endian machines.
namespace telenano::support::gwy {

template <class T>
std::string raw(T value) {
  std::string bytes(sizeof value, '\0');
  std::memcpy(bytes.data(), &value, sizeof value);
  return bytes;
}
inline std::string text(const std::string& words) {
  return words + '\0';
}
/// An object: its name, the size of its data, its data.
inline std::string object(const std::string& name, const std::string& data) {
  return text(name) + raw(static_cast<std::uint32_t>(data.size())) + data;
}
/// A component: its name, the letter of its type, its value.
inline std::string component(const std::string& name, char type, const std::string& value) {
  return text(name) + type + value;
}
inline std::string doubles(const std::vector<double>& values) {
  std::string bytes = raw(static_cast<std::uint32_t>(values.size()));
  for (const double value : values) bytes += raw(value);
  return bytes;
}
inline std::string unit(const std::string& words) {
  return object("GwySIUnit", component("unitstr", 's', text(words)));
}

struct Field {
  int columns = 0;
  int rows = 0;
  double width = 0;
  double height = 0;
  std::vector<double> values{};  ///< rows from top to bottom
  std::string unit_xy = "m";
  std::string unit_z = "m";
};
inline std::string field(const Field& of) {
  return object("GwyDataField",
                component("xres", 'i', raw(std::int32_t{of.columns})) +
                    component("yres", 'i', raw(std::int32_t{of.rows})) +
                    component("xreal", 'd', raw(of.width)) + component("yreal", 'd', raw(of.height)) +
                    component("xoff", 'd', raw(0.0)) + component("si_unit_xy", 'o', unit(of.unit_xy)) +
                    component("si_unit_z", 'o', unit(of.unit_z)) +
                    component("data", 'D', doubles(of.values)));
}
inline std::string channel(int number, const std::string& title, const Field& of) {
  const std::string key = "/" + std::to_string(number) + "/data";
  return component(key, 'o', field(of)) + component(key + "/title", 's', text(title));
}
inline std::string file(const std::string& components) {
  return "GWYP" + object("GwyContainer", components);
}

}  // namespace telenano::support::gwy

#include "telenano/common/surface/gsf.h"

#include <fcntl.h>
#include <stdio.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <string_view>
#include <vector>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/error.h"

namespace telenano::surface {
namespace {

constexpr std::string_view kMagic = "Gwyddion Simple Field 1.0\n";
constexpr std::size_t kHeaderMax = 65536;
constexpr int kSizeMin = 2;
constexpr int kSizeMax = 8192;
constexpr std::size_t kFileBytesMax = kHeaderMax + 8 + 4 * std::size_t{kSizeMax} * kSizeMax;
constexpr double kExtentMin_m = 1e-10;
constexpr double kExtentMax_m = 1e-3;
constexpr double kOffsetMax_m = 1;
constexpr double kHeightMax_nm = 1e5;

[[noreturn]] void fail(const std::string& name, const std::string& message) {
  throw UserError(name + ": " + message);
}

// What people have scans in, by how it begins: .gwy, and the header of NanoScope and its kin.
std::string foreign(std::string_view bytes) {
  if (bytes.substr(0, 4) == "GWYP" || bytes.substr(0, 4) == "GWYO")
    return "is a Gwyddion file (.gwy), no Gwyddion Simple Field";
  if (bytes.substr(0, 2) == "\\*" || bytes.substr(0, 2) == "?*")
    return "is a NanoScope file (.spm), no Gwyddion Simple Field";
  return "is no Gwyddion Simple Field";
}

std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(" \t\r");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t\r") - first + 1);
}

// A value in quotes, kept to one short printable piece.
std::string shown(std::string_view value) {
  std::string text = "'";
  for (const char c : value.substr(0, 40)) text.push_back(static_cast<unsigned char>(c) < 0x20 ? '?' : c);
  text.push_back('\'');
  return text;
}

using Header = std::map<std::string, std::string, std::less<>>;

int resolution(const Header& header, const char* key, const std::string& name) {
  const std::string expected = std::string(", expected an integer in [2, 8192]");
  const auto entry = header.find(key);
  if (entry == header.end()) fail(name, std::string("missing key ") + key + expected);
  int value = 0;
  const std::string& text = entry->second;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || value < kSizeMin || value > kSizeMax) {
    fail(name, std::string(key) + " is " + shown(text) + expected);
  }
  return value;
}

double extent_m(const Header& header, const char* key, const std::string& name) {
  const std::string expected = std::string(", expected a length in [1e-10, 1e-3] m");
  const auto entry = header.find(key);
  if (entry == header.end()) fail(name, std::string("missing key ") + key + expected);
  double value = 0;
  const std::string& text = entry->second;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() ||
      !(value >= kExtentMin_m && value <= kExtentMax_m)) {
    fail(name, std::string(key) + " is " + shown(text) + expected);
  }
  return value;
}

// Nobody's scan is refused for a place that is not needed.
double offset_nm(const Header& header, const char* key) {
  const auto entry = header.find(key);
  if (entry == header.end()) return 0;
  double value = 0;
  const std::string& text = entry->second;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  const bool whole = error == std::errc() && end == text.data() + text.size();
  return whole && std::fabs(value) <= kOffsetMax_m ? value * kNmPerM : 0;
}

void require_metres(const Header& header, const char* key, const std::string& name) {
  const auto entry = header.find(key);
  if (entry == header.end()) fail(name, std::string("missing key ") + key + ", expected 'm'");
  if (entry->second != "m") fail(name, std::string(key) + " is " + shown(entry->second) + ", expected 'm'");
}

Header parse_header(std::string_view text, const std::string& name) {
  Header header;
  std::size_t line_number = 1;
  while (!text.empty()) {
    ++line_number;
    const std::size_t end = text.find('\n');
    if (end == std::string_view::npos) {
      fail(name, "header line " + std::to_string(line_number) + " does not end in a newline");
    }
    const std::string_view line = text.substr(0, end);
    const std::size_t equals = line.find('=');
    if (equals == std::string_view::npos) {
      fail(name,
           "header line " + std::to_string(line_number) + " is " + shown(line) + ", expected 'name = value'");
    }
    header[std::string(trimmed(line.substr(0, equals)))] = std::string(trimmed(line.substr(equals + 1)));
    text.remove_prefix(end + 1);
  }
  return header;
}

float little_endian_float(const char* bytes) {
  std::uint32_t bits = 0;
  for (int i = 3; i >= 0; --i) bits = bits << 8 | static_cast<unsigned char>(bytes[i]);
  return std::bit_cast<float>(bits);
}

void append_little_endian(std::string& bytes, float value) {
  const auto bits = std::bit_cast<std::uint32_t>(value);
  for (int i = 0; i < 4; ++i) bytes.push_back(static_cast<char>(bits >> 8 * i & 0xff));
}

std::string exact(double value) {
  char text[32];
  const auto [end, error] =
      std::to_chars(text, text + sizeof text, value);  // shortest that reads back the same
  return error == std::errc() ? std::string(text, end) : std::string();
}

// One line of header: what would end it becomes a blank.
std::string one_line(std::string text) {
  for (char& c : text) {
    if (static_cast<unsigned char>(c) < 0x20) c = ' ';
  }
  return std::string(trimmed(text));
}

}  // namespace

Scan parse_gsf(const std::string& bytes, const std::string& name) {
  if (bytes.compare(0, kMagic.size(), kMagic) != 0) {
    fail(name,
         foreign(bytes) +
             ": the first line must be 'Gwyddion Simple Field 1.0'; telenano-nve import FILE makes a scene "
             "of it");
  }
  const std::size_t header_end = bytes.find('\0');
  if (header_end == std::string::npos || header_end > kHeaderMax) {
    fail(name, "the header has no end: expected a NUL byte within the first 65536 bytes");
  }
  const Header header =
      parse_header(std::string_view(bytes).substr(kMagic.size(), header_end - kMagic.size()), name);

  Scan scan;
  HeightGrid& grid = scan.grid;
  grid.columns = resolution(header, "XRes", name);
  grid.rows = resolution(header, "YRes", name);
  require_metres(header, "XYUnits", name);
  require_metres(header, "ZUnits", name);
  scan.width_nm = extent_m(header, "XReal", name) * kNmPerM;
  scan.height_nm = extent_m(header, "YReal", name) * kNmPerM;
  grid.dx_nm = scan.width_nm / grid.columns;
  grid.dy_nm = scan.height_nm / grid.rows;
  grid.x_first_nm = 0.5 * grid.dx_nm;
  grid.y_first_nm = 0.5 * grid.dy_nm;
  if (const auto title = header.find("Title"); title != header.end()) scan.title = one_line(title->second);
  scan.x_offset_nm = offset_nm(header, "XOffset");
  scan.y_offset_nm = offset_nm(header, "YOffset");
  if (const auto frame = header.find(kFrameKey); frame != header.end())
    scan.in_frame_w = frame->second == "W";

  const std::size_t data = (header_end / 4 + 1) * 4;
  const std::size_t count = static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows);
  const std::size_t expected = data + 4 * count;
  for (std::size_t i = header_end; i < std::min(data, bytes.size()); ++i) {
    if (bytes[i] != '\0') fail(name, "padding byte " + std::to_string(i) + " after the header is not NUL");
  }
  if (bytes.size() != expected) {
    const std::string how = bytes.size() < expected ? "is truncated: " : "has bytes after the data: ";
    fail(name, how + std::to_string(bytes.size()) + " bytes, expected " + std::to_string(expected) + " for " +
                   std::to_string(grid.columns) + " x " + std::to_string(grid.rows) + " samples");
  }

  grid.z_nm.resize(count);
  std::size_t bad = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const double z_nm = static_cast<double>(little_endian_float(bytes.data() + data + 4 * i)) * kNmPerM;
    const std::size_t row_from_top = i / grid.columns;
    grid.z_nm[(grid.rows - 1 - row_from_top) * grid.columns + i % grid.columns] = z_nm;
    if (!std::isfinite(z_nm)) ++bad;
  }
  if (bad != 0) {
    fail(name, std::to_string(bad) + " of " + std::to_string(count) +
                   " heights are not finite; expected finite heights (fill the gaps first)");
  }
  const auto [lowest, highest] = std::minmax_element(grid.z_nm.begin(), grid.z_nm.end());
  if (*highest - *lowest > kHeightMax_nm) {
    std::ostringstream range;
    range << *highest - *lowest;
    fail(name, "heights range over " + range.str() + " nm, expected at most 1e5 nm (are they in m?)");
  }
  scan.lowest_before_shift_nm = *lowest;
  for (double& z : grid.z_nm) z -= scan.lowest_before_shift_nm;
  return scan;
}

Scan read_gsf(const std::string& path, std::string* content) {
  std::error_code error;
  if (std::filesystem::is_directory(path, error)) fail(path, "is a folder, expected a .gsf scan");
  std::ifstream file(path, std::ios::binary);
  if (!file) fail(path, std::string("the scan cannot be read: ") + std::strerror(errno));
  // A device or a wrong file may have no end.
  std::string bytes;
  std::vector<char> block(std::size_t{1} << 20);
  while (file) {
    file.read(block.data(), static_cast<std::streamsize>(block.size()));
    bytes.append(block.data(), static_cast<std::size_t>(file.gcount()));
    if (bytes.size() > kFileBytesMax) fail(path, "is longer than the largest scan, 8192 x 8192 heights");
  }
  Scan scan = parse_gsf(bytes, path);
  if (content != nullptr) *content = std::move(bytes);
  return scan;
}

HeightGrid heights_in_frame_w(Scan scan) {
  if (scan.in_frame_w) {
    scan.grid.x_first_nm += scan.x_offset_nm;
    scan.grid.y_first_nm += scan.y_offset_nm;
    for (double& z : scan.grid.z_nm) z += scan.lowest_before_shift_nm;
  }
  return std::move(scan.grid);
}

std::string format_gsf(const Scan& scan, const std::string& name) {
  const HeightGrid& grid = scan.grid;
  const auto in_range = [](int n) { return n >= kSizeMin && n <= kSizeMax; };
  if (!in_range(grid.columns) || !in_range(grid.rows) ||
      grid.z_nm.size() != static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows)) {
    fail(name, "the scan has " + std::to_string(grid.z_nm.size()) + " heights of " +
                   std::to_string(grid.columns) + " x " + std::to_string(grid.rows) +
                   ", expected all of 2 to 8192 a side");
  }
  for (const double z : grid.z_nm) {
    if (!std::isfinite(z)) fail(name, "the scan has heights that are not finite");
  }
  // A scan as read knows its size exactly, the grid only to rounding.
  const double width_nm = scan.width_nm > 0 ? scan.width_nm : grid.columns * grid.dx_nm;
  const double height_nm = scan.height_nm > 0 ? scan.height_nm : grid.rows * grid.dy_nm;
  std::string bytes(kMagic);
  const auto line = [&](const char* key, const std::string& value) {
    bytes += std::string(key) + " = " + value + "\n";
  };
  line("XRes", std::to_string(grid.columns));
  line("YRes", std::to_string(grid.rows));
  line("XReal", exact(width_nm / kNmPerM));
  line("YReal", exact(height_nm / kNmPerM));
  const double x_nm = grid.x_first_nm - 0.5 * grid.dx_nm + (scan.in_frame_w ? scan.x_offset_nm : 0);
  const double y_nm = grid.y_first_nm - 0.5 * grid.dy_nm + (scan.in_frame_w ? scan.y_offset_nm : 0);
  if (x_nm != 0.0) line("XOffset", exact(x_nm / kNmPerM));
  if (y_nm != 0.0) line("YOffset", exact(y_nm / kNmPerM));
  line("XYUnits", "m");
  line("ZUnits", "m");
  if (const std::string title = one_line(scan.title); !title.empty()) line("Title", title);
  if (scan.in_frame_w) line(kFrameKey, "W");
  bytes.append(4 - bytes.size() % 4, '\0');
  bytes.reserve(bytes.size() + 4 * grid.z_nm.size());
  for (int row = grid.rows - 1; row >= 0; --row) {
    for (int column = 0; column < grid.columns; ++column) {
      const std::size_t i = static_cast<std::size_t>(row) * static_cast<std::size_t>(grid.columns) +
                            static_cast<std::size_t>(column);
      append_little_endian(bytes, static_cast<float>((grid.z_nm[i] + scan.lowest_before_shift_nm) / kNmPerM));
    }
  }
  return bytes;
}

namespace {

[[noreturn]] void cannot_write(const std::string& path, const std::string& why) {
  throw RunError(path + ": the surface cannot be written: " + why);
}

/// A new file PATH.part, or with `over` whatever is there, holds `bytes`, on the disk. False: it is there.
bool write_beside(const std::string& path, const std::string& bytes, bool over) {
  const std::string beside = path + ".part";
  const int fd = ::open(beside.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC | (over ? O_TRUNC : O_EXCL), 0666);
  if (fd < 0 && !over && errno == EEXIST) return false;
  if (fd < 0) cannot_write(path, std::strerror(errno));
  int error = 0;
  for (std::size_t done = 0; error == 0 && done < bytes.size();) {
    const ssize_t n = ::write(fd, bytes.data() + done, bytes.size() - done);
    if (n > 0) done += static_cast<std::size_t>(n);
    if (n <= 0 && errno != EINTR) error = n == 0 ? EIO : errno;
  }
  if (error == 0 && ::fsync(fd) != 0) error = errno;
  if (::close(fd) != 0 && error == 0) error = errno;
  if (error == 0) return true;
  ::unlink(beside.c_str());
  cannot_write(path, std::strerror(error));
}

/// The name, too, goes to the disk. Where a folder cannot be told to, it goes when the system likes.
void sync_folder_of(const std::string& path) {
  const auto folder = std::filesystem::path(path).parent_path();
  const int fd = ::open(folder.empty() ? "." : folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) return;
  ::fsync(fd);
  ::close(fd);
}

}  // namespace

void write_gsf(const std::string& path, const Scan& scan) {
  const std::string bytes = format_gsf(scan, path);
  // A device or a pipe would be replaced by a file: only a file may be.
  std::error_code error;
  const auto there = std::filesystem::status(path, error).type();
  if (there == std::filesystem::file_type::directory) cannot_write(path, "it is a folder");
  if (there != std::filesystem::file_type::regular && there != std::filesystem::file_type::not_found)
    cannot_write(path, "it is no regular file");
  write_beside(path, bytes, true);
  const std::string beside = path + ".part";
  if (::rename(beside.c_str(), path.c_str()) != 0) {
    const int why = errno;
    ::unlink(beside.c_str());
    cannot_write(path, std::strerror(why));
  }
  sync_folder_of(path);
}

bool create_gsf(const std::string& path, const Scan& scan) {
  const std::string bytes = format_gsf(scan, path);
  std::error_code error;
  if (std::filesystem::symlink_status(path, error).type() != std::filesystem::file_type::not_found)
    return false;
  if (!write_beside(path, bytes, false)) return false;
  const std::string beside = path + ".part";
  // Neither call replaces what has come meanwhile; some file systems know only one of them.
  const bool moved = ::renameat2(AT_FDCWD, beside.c_str(), AT_FDCWD, path.c_str(), RENAME_NOREPLACE) == 0;
  const bool linked = !moved && errno != EEXIST && ::link(beside.c_str(), path.c_str()) == 0;
  const int why = errno;
  if (!moved) ::unlink(beside.c_str());
  if (!moved && !linked && why != EEXIST) cannot_write(path, std::strerror(why));
  sync_folder_of(path);
  return moved || linked;
}

}  // namespace telenano::surface

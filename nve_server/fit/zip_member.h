#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace telenano::fit {

/// One file of a zip archive, stored or deflated (PKWARE, APPNOTE.TXT 6.3, sections 4.3.7 and 4.3.12).
struct ZipMember {
  std::string_view name;
  std::string_view packed;  ///< part of the archive's bytes
  std::size_t size = 0;     ///< unpacked, as the archive says; not trusted
  bool deflated = false;
};

struct ZipDirectory {
  std::vector<ZipMember> members;  ///< those that can be read
  std::string error;
};

/// By the central directory at the end. Members that are encrypted or packed otherwise are an error.
ZipDirectory read_zip(std::string_view bytes);

/// Unpacks into `out`; false if it is damaged or has more than `most` bytes.
bool unpack(const ZipMember& member, std::size_t most, std::string& out);

/// The same of a stream with zlib's head and checksum (RFC 1950). Takes memory as it goes on, not before.
bool unpack_zlib(std::string_view packed, std::size_t most, std::string& out);

}  // namespace telenano::fit

#include "telenano/nve_server/fit/zip_member.h"

#include <zlib.h>

#include <algorithm>

namespace telenano::fit {
namespace {

constexpr std::size_t kEndBytes = 22;
constexpr std::size_t kCommentMax = 65535;
constexpr std::size_t kCentralBytes = 46;
constexpr std::size_t kLocalBytes = 30;
constexpr std::size_t kMembersMax = 4096;

// Only where at + n <= bytes.size().
std::uint32_t number(std::string_view bytes, std::size_t at, int n) {
  std::uint32_t value = 0;
  for (int i = n - 1; i >= 0; --i)
    value = value << 8 | static_cast<unsigned char>(bytes[at + static_cast<std::size_t>(i)]);
  return value;
}

}  // namespace

ZipDirectory read_zip(std::string_view bytes) {
  ZipDirectory directory;
  const auto fail = [&](const char* why) {
    directory.members.clear();
    directory.error = why;
    return directory;
  };
  if (bytes.size() < kEndBytes) return fail("is not a complete zip archive: it is too short");
  const std::size_t last = bytes.size() - kEndBytes;
  const std::size_t first = last > kCommentMax ? last - kCommentMax : 0;
  std::size_t end = std::string_view::npos;
  for (std::size_t at = last + 1; at-- > first;) {
    if (bytes.substr(at, 4) == std::string_view("PK\5\6", 4)) {
      end = at;
      break;
    }
  }
  if (end == std::string_view::npos)
    return fail("is not a complete zip archive: its directory is missing (cut off?)");
  const std::size_t count = number(bytes, end + 10, 2);
  std::size_t at = number(bytes, end + 16, 4);
  if (count > kMembersMax) return fail("has more than 4096 files in its archive, expected one force curve");
  for (std::size_t i = 0; i < count; ++i) {
    if (at > bytes.size() || bytes.size() - at < kCentralBytes ||
        bytes.substr(at, 4) != std::string_view("PK\1\2", 4)) {
      return fail("is a damaged zip archive: its directory ends early");
    }
    const std::uint32_t flags = number(bytes, at + 8, 2);
    const std::uint32_t method = number(bytes, at + 10, 2);
    const std::size_t packed = number(bytes, at + 20, 4);
    const std::size_t name_size = number(bytes, at + 28, 2);
    const std::size_t more = number(bytes, at + 30, 2) + number(bytes, at + 32, 2);
    const std::size_t local = number(bytes, at + 42, 4);
    if (bytes.size() - at - kCentralBytes < name_size + more)
      return fail("is a damaged zip archive: its directory ends early");
    ZipMember member;
    member.name = bytes.substr(at + kCentralBytes, name_size);
    member.size = number(bytes, at + 24, 4);
    member.deflated = method == 8;
    at += kCentralBytes + name_size + more;
    if ((flags & 1U) != 0 || (method != 0 && method != 8))
      return fail("is a zip archive that is encrypted or packed in an unknown way");
    if (local > bytes.size() || bytes.size() - local < kLocalBytes ||
        bytes.substr(local, 4) != std::string_view("PK\3\4", 4)) {
      return fail("is a damaged zip archive: a file in it is missing");
    }
    // The local header's own lengths: its extra field may differ from the directory's.
    const std::size_t skip = kLocalBytes + number(bytes, local + 26, 2) + number(bytes, local + 28, 2);
    if (bytes.size() - local < skip || bytes.size() - local - skip < packed)
      return fail("is a damaged zip archive: a file in it is cut off");
    member.packed = bytes.substr(local + skip, packed);
    directory.members.push_back(member);
  }
  return directory;
}

bool unpack(const ZipMember& member, std::size_t most, std::string& out) {
  out.clear();
  if (!member.deflated) {
    if (member.packed.size() > most) return false;
    out.assign(member.packed);
    return true;
  }
  if (member.size > most) return false;
  out.resize(member.size);
  z_stream stream{};
  if (inflateInit2(&stream, -MAX_WBITS) != Z_OK) return false;
  // zlib reads only from what it calls a mutable byte.
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(member.packed.data()));  // NOLINT
  stream.avail_in = static_cast<uInt>(member.packed.size());
  Bytef nothing = 0;
  stream.next_out = out.empty() ? &nothing : reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  const int result = inflate(&stream, Z_FINISH);
  const bool whole = result == Z_STREAM_END && stream.total_out == member.size;
  inflateEnd(&stream);
  if (!whole) out.clear();
  return whole;
}

bool unpack_zlib(std::string_view packed, std::size_t most, std::string& out) {
  out.clear();
  z_stream stream{};
  if (inflateInit(&stream) != Z_OK) return false;
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(packed.data()));  // NOLINT
  stream.avail_in = static_cast<uInt>(packed.size());
  int result = Z_OK;
  while (result == Z_OK && out.size() < most) {
    const std::size_t before = out.size();
    out.resize(std::min(most, before + std::max<std::size_t>(before, 4096)));
    stream.next_out = reinterpret_cast<Bytef*>(out.data() + before);
    stream.avail_out = static_cast<uInt>(out.size() - before);
    result = inflate(&stream, Z_NO_FLUSH);
    out.resize(out.size() - stream.avail_out);
  }
  inflateEnd(&stream);
  if (result != Z_STREAM_END) out.clear();
  return result == Z_STREAM_END;
}

}  // namespace telenano::fit

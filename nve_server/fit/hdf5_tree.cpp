#include "telenano/nve_server/fit/hdf5_tree.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>

#include "telenano/nve_server/fit/zip_member.h"

namespace telenano::fit {
namespace {

constexpr std::size_t kNodesMax = 20'000;  // of trees, and blocks of a header, that one look-up visits
constexpr std::size_t kMessagesMax = 4096;
constexpr std::size_t kTextMax = 4096;
constexpr std::uint64_t kNowhere = ~std::uint64_t{0};

std::uint64_t little(std::string_view bytes, std::size_t n) {
  std::uint64_t value = 0;
  for (std::size_t i = n; i-- > 0;) value = value << 8 | static_cast<unsigned char>(bytes[i]);
  return value;
}

/// `size` bytes at `at`, or none.
std::optional<std::string_view> part(std::string_view bytes, std::uint64_t at, std::uint64_t size) {
  if (at > bytes.size() || size > bytes.size() - at) return std::nullopt;
  return bytes.substr(static_cast<std::size_t>(at), static_cast<std::size_t>(size));
}

/// Reads on in a piece of the file; what lies behind its end is 0, and `good` falls.
class Cursor {
 public:
  explicit Cursor(std::string_view bytes) : rest_(bytes) {}
  std::uint64_t number(std::size_t n) {
    const std::string_view piece = take(n);
    return piece.size() == n ? little(piece, n) : 0;
  }
  std::string_view take(std::uint64_t n) {
    if (n > rest_.size()) {
      good = false;
      rest_ = {};
      return {};
    }
    const std::string_view piece = rest_.substr(0, static_cast<std::size_t>(n));
    rest_.remove_prefix(static_cast<std::size_t>(n));
    return piece;
  }
  std::string_view rest() const { return rest_; }
  bool good = true;

 private:
  std::string_view rest_;
};

std::uint64_t padded(std::uint64_t size) {
  return (size + 7) / 8 * 8;
}

struct Datatype {
  enum class Kind { kNone, kSigned, kUnsigned, kFloat, kText, kSharedText } kind = Kind::kNone;
  bool big = false;  // byte order
  std::size_t size = 0;
};

Datatype datatype_of(std::string_view data) {
  Cursor in(data);
  const std::uint64_t head = in.number(1);
  const std::uint64_t bits = in.number(3);
  Datatype type;
  type.size = static_cast<std::size_t>(in.number(4));
  if (!in.good) return {};
  switch (head & 0xf) {
    case 0:
    case 8: {
      // An enumeration (h5py's bool) is its base type, which follows.
      if ((head & 0xf) == 8) {
        Datatype base = datatype_of(in.rest().substr(0, 12));
        return base.kind == Datatype::Kind::kSigned || base.kind == Datatype::Kind::kUnsigned ? base
                                                                                              : Datatype{};
      }
      const bool whole = in.number(2) == 0 && in.number(2) == 8 * type.size;
      const bool known = type.size == 1 || type.size == 2 || type.size == 4 || type.size == 8;
      if (!whole || !known) return {};
      type.kind = (bits & 8) != 0 ? Datatype::Kind::kSigned : Datatype::Kind::kUnsigned;
      type.big = (bits & 1) != 0;
      return type;
    }
    case 1:
      if ((type.size != 4 && type.size != 8) || (bits & 0x40) != 0) return {};
      type.kind = Datatype::Kind::kFloat;
      type.big = (bits & 1) != 0;
      return type;
    case 3:
      type.kind = Datatype::Kind::kText;
      return type;
    case 9:
      if ((bits & 0xf) != 1 || type.size != 16) return {};
      type.kind = Datatype::Kind::kSharedText;
      return type;
    default:
      return {};
  }
}

double number_of(std::string_view bytes, const Datatype& type) {
  std::array<char, 8> turned{};
  std::copy(bytes.begin(), bytes.end(), turned.begin());
  if (type.big) std::reverse(turned.begin(), turned.begin() + static_cast<std::ptrdiff_t>(type.size));
  const std::uint64_t bits = little({turned.data(), type.size}, type.size);
  if (type.kind == Datatype::Kind::kFloat) {
    return type.size == 4 ? static_cast<double>(std::bit_cast<float>(static_cast<std::uint32_t>(bits)))
                          : std::bit_cast<double>(bits);
  }
  if (type.kind == Datatype::Kind::kUnsigned) return static_cast<double>(bits);
  const unsigned up = static_cast<unsigned>(64 - 8 * type.size);
  return static_cast<double>(static_cast<std::int64_t>(bits << up) >> up);
}

/// Numbers in all, or none: no dataspace that is read.
struct Dataspace {
  bool good = false;
  std::size_t rank = 0;
  std::uint64_t count = 1;
};

Dataspace dataspace_of(std::string_view data) {
  Cursor in(data);
  const std::uint64_t version = in.number(1);
  Dataspace space;
  space.rank = static_cast<std::size_t>(in.number(1));
  in.number(1);
  if (version == 1)
    in.take(5);
  else if (version != 2 || in.number(1) == 2)
    return {};
  if (space.rank > 4) return {};
  for (std::size_t i = 0; i < space.rank; ++i) {
    const std::uint64_t side = in.number(8);
    if (side != 0 && space.count > (std::uint64_t{1} << 40) / side) return {};
    space.count *= side;
  }
  space.good = in.good;
  return space;
}

struct Filter {
  std::uint64_t id = 0;
  std::uint64_t first_value = 0;
};

bool filters_of(std::string_view data, std::vector<Filter>& filters) {
  Cursor in(data);
  const std::uint64_t version = in.number(1);
  const std::uint64_t count = in.number(1);
  if (version == 1) in.take(6);
  if ((version != 1 && version != 2) || count > 8) return false;
  for (std::uint64_t i = 0; i < count && in.good; ++i) {
    Filter filter;
    filter.id = in.number(2);
    const std::uint64_t name = version == 1 || filter.id >= 256 ? in.number(2) : 0;
    in.number(2);
    const std::uint64_t values = in.number(2);
    in.take(version == 1 ? padded(name) : name);
    for (std::uint64_t k = 0; k < values && in.good; ++k) {
      const std::uint64_t value = in.number(4);
      if (k == 0) filter.first_value = value;
    }
    if (version == 1 && values % 2 == 1) in.take(4);
    filters.push_back(filter);
  }
  return in.good;
}

/// Fletcher's sum over 16-bit words as the HDF5 library forms it, the first byte the high one. Sums are modulo
/// 65535, where the library may say 65535 for 0.
bool has_sum(std::string_view bytes, std::uint32_t sum) {
  std::uint32_t a = 0;
  std::uint32_t b = 0;
  for (std::size_t i = 0; i < bytes.size(); i += 2) {
    const auto high = static_cast<std::uint32_t>(static_cast<unsigned char>(bytes[i])) << 8;
    const auto low =
        i + 1 < bytes.size() ? static_cast<std::uint32_t>(static_cast<unsigned char>(bytes[i + 1])) : 0U;
    a = (a + (high | low)) % 65535U;
    b = (b + a) % 65535U;
  }
  return (sum & 0xffffU) % 65535U == a && (sum >> 16) % 65535U == b;
}

/// Undoes the filters, last one first; the piece then has `size` bytes.
bool unfilter(std::string_view stored, const std::vector<Filter>& filters, std::uint64_t skipped,
              std::size_t size, std::size_t width, std::string& out) {
  out.assign(stored);
  for (std::size_t i = filters.size(); i-- > 0;) {
    if ((skipped >> i & 1) != 0) continue;
    switch (filters[i].id) {
      case 1: {
        const std::string packed = std::move(out);
        if (!unpack_zlib(packed, size + 8, out)) return false;
        break;
      }
      case 2: {
        const std::size_t each = static_cast<std::size_t>(filters[i].first_value);
        if (each != width || each == 0) return false;
        const std::size_t n = out.size() / each;
        std::string sorted = out;
        for (std::size_t k = 0; k < n; ++k)
          for (std::size_t j = 0; j < each; ++j) sorted[k * each + j] = out[j * n + k];
        out = std::move(sorted);
        break;
      }
      case 3: {
        if (out.size() < 4) return false;
        const auto sum = static_cast<std::uint32_t>(little(std::string_view(out).substr(out.size() - 4), 4));
        out.resize(out.size() - 4);
        if (!has_sum(out, sum)) return false;
        break;
      }
      default:
        return false;
    }
  }
  return out.size() == size;
}

}  // namespace

Hdf5Tree::Hdf5Tree(std::string_view bytes) : bytes_(bytes) {
  Cursor in(bytes);
  in.take(8);
  const std::uint64_t version = in.number(1);
  if (in.good && version > 1) {
    error_ =
        "is HDF5 in a layout of newer libraries (superblock " + std::to_string(version) +
        "), which is not supported: write it with h5py's default, or copy it with h5repack --low=0 --high=0";
    return;
  }
  in.take(4);
  const std::uint64_t offsets = in.number(1);
  const std::uint64_t lengths = in.number(1);
  in.take(9);
  if (version == 1) in.take(4);
  const std::uint64_t base = in.number(8);
  in.take(24);
  in.take(8);
  root_ = in.number(8);
  if (!in.good) {
    error_ = "is cut off: HDF5 that ends within its first block";
  } else if (offsets != 8 || lengths != 8 || base != 0) {
    error_ =
        "is HDF5 in a layout that is not supported: its addresses are not 8 bytes long and counted from the "
        "beginning of the file";
  }
}

std::vector<Hdf5Tree::Message> Hdf5Tree::messages(Address object) const {
  std::vector<Message> all;
  const auto head = part(bytes_, object, 16);
  if (!head || (*head)[0] != 1) return all;
  std::size_t left =
      std::min<std::size_t>(static_cast<std::size_t>(little(head->substr(2), 2)), kMessagesMax);
  std::vector<std::string_view> blocks;
  const auto first = part(bytes_, object + 16, little(head->substr(8), 4));
  if (!first) return all;
  blocks.push_back(*first);
  for (std::size_t i = 0; i < blocks.size() && i < 64; ++i) {
    Cursor in(blocks[i]);
    while (left > 0 && in.rest().size() >= 8) {
      --left;
      Message message;
      message.type = static_cast<unsigned>(in.number(2));
      const std::uint64_t size = in.number(2);
      const std::uint64_t flags = in.number(1);
      in.take(3);
      message.data = in.take(size);
      if (!in.good) return all;
      if (message.type == 0x10 && size >= 16) {
        const auto more = part(bytes_, little(message.data, 8), little(message.data.substr(8), 8));
        if (more) blocks.push_back(*more);
      } else if ((flags & 2) == 0) {  // else it stands elsewhere in the file, shared
        all.push_back(message);
      }
    }
  }
  return all;
}

std::vector<Hdf5Tree::Member> Hdf5Tree::members(Address group) const {
  std::vector<Member> all;
  std::vector<Address> nodes;
  std::optional<std::string_view> names;
  for (const Message& message : messages(group)) {
    if (message.type != 0x11 || message.data.size() < 16) continue;
    nodes.push_back(little(message.data, 8));
    const auto heap = part(bytes_, little(message.data.substr(8), 8), 32);
    if (!heap || !heap->starts_with("HEAP")) return all;
    names = part(bytes_, little(heap->substr(24), 8), little(heap->substr(8), 8));
    break;
  }
  if (!names) return all;
  // The tree, last child first on the stack, so that members come in order.
  for (std::size_t visited = 0; !nodes.empty() && visited < kNodesMax; ++visited) {
    const Address at = nodes.back();
    nodes.pop_back();
    const auto head = part(bytes_, at, 8);
    if (!head) continue;
    if (head->starts_with("TREE")) {
      const std::uint64_t count = little(head->substr(6), 2);
      const auto entries = part(bytes_, at + 24, 16 * count);
      if ((*head)[4] != 0 || !entries || nodes.size() + count > kNodesMax) continue;
      for (std::uint64_t i = count; i-- > 0;)
        nodes.push_back(little(entries->substr(static_cast<std::size_t>(16 * i + 8)), 8));
    } else if (head->starts_with("SNOD")) {
      const std::uint64_t count = little(head->substr(6), 2);
      const auto entries = part(bytes_, at + 8, 40 * count);
      if (!entries) continue;
      for (std::uint64_t i = 0; i < count && all.size() < kNodesMax; ++i) {
        const std::string_view entry = entries->substr(static_cast<std::size_t>(40 * i), 40);
        const std::uint64_t name = little(entry, 8);
        if (name >= names->size()) continue;
        const std::string_view text = names->substr(static_cast<std::size_t>(name), 256);
        all.push_back({std::string(text.substr(0, text.find('\0'))), little(entry.substr(8), 8)});
      }
    }
  }
  return all;
}

std::optional<Hdf5Tree::Address> Hdf5Tree::find(Address group, std::string_view name) const {
  for (const Member& member : members(group))
    if (member.name == name) return member.at;
  return std::nullopt;
}

std::map<std::string, Hdf5Tree::Attribute, std::less<>> Hdf5Tree::attributes(Address object) const {
  std::map<std::string, Attribute, std::less<>> all;
  for (const Message& message : messages(object)) {
    if (message.type != 0xc) continue;
    Cursor in(message.data);
    const std::uint64_t version = in.number(1);
    in.number(1);
    const std::uint64_t name_size = in.number(2);
    const std::uint64_t type_size = in.number(2);
    const std::uint64_t space_size = in.number(2);
    if (version == 3) in.number(1);
    const auto size = [&](std::uint64_t n) { return version == 1 ? padded(n) : n; };
    std::string_view name = in.take(size(name_size));
    name = name.substr(0, name.find('\0'));
    const Datatype type = datatype_of(in.take(size(type_size)));
    const Dataspace space = dataspace_of(in.take(size(space_size)));
    if (!in.good || version < 1 || version > 3 || !space.good || space.count != 1) continue;
    const std::string_view value = in.take(type.size);
    if (!in.good) continue;
    Attribute attribute;
    switch (type.kind) {
      case Datatype::Kind::kNone:
        continue;
      case Datatype::Kind::kText: {
        const std::string_view text = value.substr(0, kTextMax);
        attribute.text = std::string(text.substr(0, text.find('\0')));
        break;
      }
      case Datatype::Kind::kSharedText: {
        // Length, and where in a heap of such texts.
        const std::uint64_t length = little(value, 4);
        const Address at = little(value.substr(4), 8);
        const std::uint64_t index = little(value.substr(12), 4);
        const auto head = part(bytes_, at, 16);
        if (!head || !head->starts_with("GCOL")) continue;
        const std::uint64_t whole = little(head->substr(8), 8);
        const auto heap = part(bytes_, at, whole);
        if (!heap || whole < 16) continue;
        Cursor objects(heap->substr(16));
        for (std::size_t i = 0; i < kNodesMax && objects.good && objects.rest().size() >= 16; ++i) {
          const std::uint64_t here = objects.number(2);
          objects.take(6);
          const std::uint64_t bytes = objects.number(8);
          if (here == 0 || bytes > objects.rest().size()) break;
          const std::string_view text = objects.rest().substr(0, static_cast<std::size_t>(bytes));
          if (here == index) {
            attribute.text = std::string(
                text.substr(0, static_cast<std::size_t>(std::min<std::uint64_t>(length, kTextMax))));
            break;
          }
          objects.take(padded(bytes));
        }
        break;
      }
      default: {
        const double number = number_of(value, type);
        if (std::isfinite(number)) attribute.number = number;
      }
    }
    all.emplace(std::string(name), std::move(attribute));
  }
  return all;
}

bool Hdf5Tree::column(Address object, std::size_t most, std::vector<double>& out, std::string& why) const {
  Datatype type;
  Dataspace space;
  std::vector<Filter> filters;
  bool filters_known = true;
  std::string_view layout;
  for (const Message& message : messages(object)) {
    if (message.type == 1) space = dataspace_of(message.data);
    if (message.type == 3) type = datatype_of(message.data);
    if (message.type == 8) layout = message.data;
    if (message.type == 0xb) filters_known = filters_of(message.data, filters);
  }
  const bool number = type.kind == Datatype::Kind::kFloat || type.kind == Datatype::Kind::kSigned ||
                      type.kind == Datatype::Kind::kUnsigned;
  if (!space.good || space.rank != 1 || !number) {
    why = "is not a row of real numbers";
    return false;
  }
  if (space.count > most) {
    why = "has " + std::to_string(space.count) + " values, expected at most " + std::to_string(most);
    return false;
  }
  for (const Filter& filter : filters) filters_known = filters_known && filter.id >= 1 && filter.id <= 3;
  if (!filters_known) {
    why = "is packed by a filter that is not supported: expected deflate, shuffle or fletcher32";
    return false;
  }
  const auto count = static_cast<std::size_t>(space.count);
  const std::size_t size = count * type.size;
  Cursor in(layout);
  const std::uint64_t version = in.number(1);
  const std::uint64_t kind = in.number(1);
  if (version != 3 || kind > 2) {
    why = "is stored in a layout of HDF5 that is not supported";
    return false;
  }
  // No more memory than a few times what there are bytes for: packed ones are at most 1032 times as many.
  if (size / 1032 > bytes_.size()) {
    why = "is cut off";
    return false;
  }
  std::string unpacked;
  std::string_view raw;
  if (kind == 0) {
    raw = in.take(in.number(2));
  } else if (kind == 1) {
    const Address at = in.number(8);
    const auto piece = part(bytes_, at, size);
    if (piece) raw = *piece;
  } else {
    const std::uint64_t sides = in.number(1);
    Address tree = in.number(8);
    const std::uint64_t side = in.number(4);
    const std::uint64_t width = in.number(4);
    if (!in.good || sides != 2 || width != type.size || side == 0 || side > most) {
      why = "has chunks of a size that is not supported";
      return false;
    }
    // Chunks that are not there are zeros, as the library fills them.
    unpacked.assign(size, '\0');
    const auto chunk_bytes = static_cast<std::size_t>(side * width);
    std::vector<Address> nodes;
    if (tree != kNowhere) nodes.push_back(tree);
    std::string chunk;
    std::size_t chunks = 0;
    const std::size_t chunks_max = count / static_cast<std::size_t>(side) + 1;
    for (std::size_t visited = 0; !nodes.empty() && visited < kNodesMax; ++visited) {
      const Address at = nodes.back();
      nodes.pop_back();
      const auto head = part(bytes_, at, 8);
      constexpr std::uint64_t kEntry = 8 + 16 + 8;  // size, mask, two offsets; address
      const std::uint64_t entries_count = head ? little(head->substr(6), 2) : 0;
      const auto entries = part(bytes_, at + 24, kEntry * entries_count);
      if (!head || !head->starts_with("TREE") || (*head)[4] != 1 || !entries) {
        why = "has a damaged index of its chunks";
        return false;
      }
      const bool leaf = (*head)[5] == 0;
      for (std::uint64_t i = 0; i < entries_count; ++i) {
        const std::string_view entry = entries->substr(static_cast<std::size_t>(kEntry * i), kEntry);
        const Address child = little(entry.substr(24), 8);
        if (!leaf) {
          if (nodes.size() < kNodesMax) nodes.push_back(child);
          continue;
        }
        const std::uint64_t first = little(entry.substr(8), 8);
        const auto stored = part(bytes_, child, little(entry, 4));
        if (!stored || first >= count || first % side != 0 || ++chunks > chunks_max ||
            !unfilter(*stored, filters, little(entry.substr(4), 4), chunk_bytes, type.size, chunk)) {
          why = "has a damaged chunk, or an incomplete one";
          return false;
        }
        const std::size_t to = static_cast<std::size_t>(first) * type.size;
        std::copy_n(chunk.begin(), std::min(chunk_bytes, size - to),
                    unpacked.begin() + static_cast<std::ptrdiff_t>(to));
      }
    }
    raw = unpacked;
  }
  if (raw.size() < size || (kind != 2 && !filters.empty())) {
    why = "is cut off";
    return false;
  }
  out.reserve(count);
  for (std::size_t i = 0; i < count; ++i)
    out.push_back(number_of(raw.substr(i * type.size, type.size), type));
  return true;
}

}  // namespace telenano::fit

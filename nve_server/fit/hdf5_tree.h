#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace telenano::fit {

/// What stands in an HDF5 file, as far as force curves need it: groups, their attributes, columns of numbers.
///
/// By The HDF Group's "HDF5 File Format Specification Version 3.0": superblock versions 0 and 1, object headers
/// of version 1, groups with symbol tables, columns that are compact, contiguous or in chunks, filters deflate,
/// shuffle and fletcher32 (whose checksum is compared). That is what h5py and the HDF5 library write unless they
/// are told to use newer layouts, which are refused by name. A reader of our own and not the library, since a
/// damaged file can crash that. Nothing in a file makes this one recurse, run on or take memory: each address
/// and size is held against the bytes, and each look-up has a number of nodes that it may visit.
class Hdf5Tree {
 public:
  explicit Hdf5Tree(std::string_view bytes);

  /// Not empty: why the file cannot be read.
  const std::string& error() const noexcept { return error_; }

  using Address = std::uint64_t;
  Address root() const noexcept { return root_; }

  /// Names and addresses of a group's members, in the file's order (by name). Empty where it is no group.
  struct Member {
    std::string name;
    Address at = 0;
  };
  std::vector<Member> members(Address group) const;
  std::optional<Address> find(Address group, std::string_view name) const;

  struct Attribute {
    std::optional<double> number;
    std::optional<std::string> text;
  };
  /// Of a group or column: scalar numbers and texts.
  std::map<std::string, Attribute, std::less<>> attributes(Address object) const;

  /// A column of at most `most` real numbers. False: `why` says what is wrong with it.
  bool column(Address object, std::size_t most, std::vector<double>& out, std::string& why) const;

 private:
  struct Message {
    unsigned type = 0;
    std::string_view data;
  };
  /// Of an object's header.
  std::vector<Message> messages(Address object) const;

  std::string_view bytes_;
  std::string error_;
  Address root_ = 0;
};

}  // namespace telenano::fit

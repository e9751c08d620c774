#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "telenano/common/surface/height_grid.h"

/// Gwyddion's native files (.gwy), read by what their format's documentation says (Gwyddion user guide,
/// "Gwyddion native format", http://gwyddion.net/documentation/user-guide-en/gwyfile-format.html): `GWYP`,
/// then one GwyContainer. An object is its name, NUL, the size of its data as uint32, and components until
/// the data ends; a component is its name, NUL, a letter for its type, and the value. All little-endian.
namespace telenano::import {

/// A GwyDataField. The numbers stay where they are in the file.
struct GwyField {
  int columns = 0;      ///< 1 or more
  int rows = 0;         ///< 1 or more
  double width = 0;     ///< in unit_xy; as the file says it, not checked
  double height = 0;    ///< in unit_xy; as the file says it, not checked
  std::string unit_xy;  ///< without a prefix: "m"; empty: none. One printable line.
  std::string unit_z;
  std::string_view data;  ///< columns·rows float64, rows from top to bottom: part of the bytes that were read

  std::size_t count() const noexcept { return data.size() / 8; }
  /// In unit_z, as the file says it, which may be no number. i < count().
  double value(std::size_t i) const noexcept;
};

/// An image: /N/data, /N/data/title, /N/mask.
struct GwyChannel {
  int number = 0;     ///< N
  std::string title;  ///< one printable line, "" where there is none
  GwyField field;
  std::optional<GwyField> mask;  ///< of the same size; more than 0.5: marked
};

struct GwyFile {
  std::vector<GwyChannel> channels;  ///< by number
  std::string error;                 ///< not empty: what is wrong with the file, one line without its name
};

/// True for what read_gwy can read; false also for files of Gwyddion 1 (GWYO).
bool is_gwy(std::string_view bytes) noexcept;

/// Never throws but for want of memory, never needs more of it than a few words a component: each size is
/// held against what is left of its parent before anything follows it, nothing is copied, and what is not
/// wanted is passed over by its size. No recursion: a channel lies two objects deep, and deeper ones are
/// passed over. `bytes` must outlive the result.
GwyFile read_gwy(std::string_view bytes);

/// One printable line of at most `longest` bytes, valid UTF-8: control characters and what is no UTF-8 become
/// '?'.
std::string printable(std::string_view text, std::size_t longest = 120);

}  // namespace telenano::import

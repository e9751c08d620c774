#pragma once

#include <string>

#include "telenano/common/surface/height_grid.h"

namespace telenano::surface {

/// A scan as read from a Gwyddion Simple Field: heights in nm, frame W.
struct Scan {
  HeightGrid grid;
  std::string title;
  double width_nm = 0;   ///< XReal
  double height_nm = 0;  ///< YReal
  double lowest_before_shift_nm = 0;
  double x_offset_nm = 0;  ///< XOffset and YOffset as read; 0 where they are no lengths
  double y_offset_nm = 0;
  bool in_frame_w =
      false;  ///< kFrameKey: what a session left of its sample, place and heights of its frame W
};

/// Line of a .gsf's header, value W. Gwyddion keeps it as a line of text.
inline constexpr const char* kFrameKey = "TelenanoFrame";

/// The grid where the session that left it had it: what reading has shifted is shifted back. As it was read
/// unless it is in_frame_w.
HeightGrid heights_in_frame_w(Scan scan);

/// Reads a .gsf: `Gwyddion Simple Field 1.0\n`, lines `name = value\n`, 1 to 4 NULs up to a multiple of four
/// bytes, then XRes·YRes float32, little-endian, rows from top to bottom.
///
/// Frame W: x to the right, y up the image, the origin at the lower left corner of the scanned area. A sample
/// stands for the middle of its pixel: x = (column + ½)·XReal/XRes. XOffset and YOffset say where the scan
/// lay under the microscope and are left out. Heights are shifted so that the lowest sample is at z = 0.
///
/// Both units must be m; XReal and YReal must be given (the format's default of 1 m is no scan). Throws
/// UserError: one line naming file, key and expected range. `content` receives the bytes, for hashing.
Scan read_gsf(const std::string& path, std::string* content = nullptr);
Scan parse_gsf(const std::string& bytes, const std::string& name);

/// The inverse: reading the bytes gives the same grid, size and title, and writing what was read the same
/// heights bit for bit (those below 1e-8 of the range excepted, which come back to within 1e-15 of it). The
/// heights get `lowest_before_shift_nm` back. A grid that does not start half a cell from the origin has its
/// place in XOffset and YOffset; one that is in_frame_w says so, and keeps its place also when it was read. Throws UserError for a grid that cannot be read again.
std::string format_gsf(const Scan& scan, const std::string& name);

/// Writes it beside the file, to the disk, and puts it in its place in one move: whoever opens `path`, also
/// after a crash or a loss of power, sees the old scan or the new one whole. Throws RunError: one line naming
/// the file.
void write_gsf(const std::string& path, const Scan& scan);

/// The same for a file that is not there yet. False, and nothing is touched, if there is one, or one that
/// another program is writing there (PATH.part; also what a killed one has left).
bool create_gsf(const std::string& path, const Scan& scan);

}  // namespace telenano::surface

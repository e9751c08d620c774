#pragma once

#include <optional>
#include <string>

#include "telenano/common/config/slave_limits_file.h"
#include "telenano/common/surface/gsf.h"

namespace telenano::app {

// A station reads no scenes: the wire carries a scene's name and the hash of its description, which is the
// 64-bit FNV-1a of its file and its scan. Where the same files are here, they are found by these.

/// A scene's description on this machine.
struct LocalScene {
  std::string path;
  std::string text;       ///< the whole file
  std::string scan_path;  ///< of the surface; empty: it is none that was scanned
  std::string force =
      "law";                 ///< what the ground is to the tip: "law" or "potential" (config/surface_force.h)
  double tip_radius_nm = 0;  ///< 0: it has none
};

/// The scene of this name and hash (16 hexadecimal digits), if it is here: `also` (a file, may be empty), one
/// that came with the programs, or NAME.toml in the present folder. Nothing is thrown: what cannot be read is
/// not it.
std::optional<LocalScene> find_scene(const std::string& name, const std::string& hash,
                                     const std::string& also = "");

/// What --surface names: a .gsf file; a scene's name or file, for its scan; or the name of a scan that came
/// with the programs. Throws UserError.
std::string find_surface(const std::string& text);

/// A scan as read for the picture of a session.
struct GivenSurface {
  const std::string& path;
  const std::string& bytes;  ///< of the whole file
  const surface::Scan& scan;
};

/// Is it the session's? Empty: it is, to the bit, or the server wrote it (its title is the scene's name).
/// Words of doubt for a person where that cannot be told. Throws UserError where it is certainly another: it
/// does not reach as far as the session's sample, or that sample is no scan. A workspace without width is not
/// known, and not compared.
std::string doubt_of_surface(const GivenSurface& given, const config::SlaveLimits& session);

}  // namespace telenano::app

#pragma once

#include <string>
#include <string_view>

#include "telenano/nve_server/fit/raw_curve.h"

/// Force curves as instruments write them. No reader throws but for want of memory; each size is held against
/// what is left of the bytes before anything follows it, and no more memory is taken than a few times the
/// bytes or a few kPointsMax numbers.
namespace telenano::fit {

/// Which column of a text or wave is what; empty: found by its name.
struct ColumnChoice {
  std::string z;
  std::string deflection;
  std::size_t number = 0;  ///< of the curve, in a file with several (HDF5)
};

/// Of a file with several: more are not looked for.
inline constexpr std::size_t kCurvesMax = 10'000;
inline constexpr std::string_view kHdf5Begin{"\x89HDF\r\n\x1a\n", 8};

/// How many curves the bytes hold: 1 but for HDF5.
std::size_t curves_in(std::string_view bytes);

/// By what the bytes begin with: zip (.jpk-force), Igor 5 (.ibw), HDF5 (.h5), NanoScope (.spm, .000), else text
/// (.csv).
RawCurve read_curve(std::string_view bytes, const ColumnChoice& columns = {});

/// A table with commas, semicolons or tabs. The header is the first line that is followed by a line of as
/// many numbers (or of units and that line), also behind '#'; of what stands before it and of lines with '#' the
/// lever's stiffness is read, see take_stated_stiffness. A column's unit is the end of its name, or all that stands in
/// its last brackets: "z_nm", "Extend Force(nN)", "deflection [V]". Units: m, um (µm), nm, pm; N, uN, nN, pN; V,
/// mV; others are refused. Ways: a column "direction" (approach, retract, or two numbers), or columns of their own
/// ("Extend …", "Retract …"), else the turning point. What `telenano-nve curve` prints is such a table.
RawCurve read_csv(std::string_view bytes, const ColumnChoice& columns = {});

/// Igor binary wave, version 5, with columns Defl and ZSnsr or Raw in metres, as Asylum's instruments write
/// it (WaveMetrics, Technical Note 003, "Igor Binary Format"; its note has the lever and the turning point).
RawCurve read_ibw(std::string_view bytes, const ColumnChoice& columns = {});

/// JPK's force file: a zip of .properties and big-endian integers, each channel with its chain of conversions
/// (file format versions 0.x, where each segment has its own).
RawCurve read_jpk(std::string_view bytes, const ColumnChoice& columns = {});

/// HDF5 as afmformats writes it (https://afmformats.readthedocs.io): a group "0", "1", … a curve, with columns
/// "height (measured)" or "height (piezo)" in m, "force" in N and "segment" (0 approach), and the lever's
/// stiffness as attribute "spring constant". See hdf5_tree.h for which HDF5 is read.
RawCurve read_hdf5(std::string_view bytes, const ColumnChoice& columns = {});

/// A single force curve of a NanoScope instrument (Bruker, Veeco, Digital Instruments; versions 5 to 9): text
/// with "\*Ciao force image list" for each channel, then numbers. Deflection is in V with the file's
/// sensitivity; height is a Z sensor's channel, or the ramp.
RawCurve read_nanoscope(std::string_view bytes, const ColumnChoice& columns = {});

/// Of lines like "springConstant: 0.1", "# Spring Constant [pN/nm] = 100", "k,0.1,N/m" (without a unit: N/m) takes
/// the lever's stiffness; what is in another unit, or said twice with different numbers, becomes stiffness_unread.
void take_stated_stiffness(std::string_view text, RawCurve& curve);

/// One printable line of ASCII of at most `longest` bytes: everything else becomes '?'.
std::string plain_line(std::string_view text, std::size_t longest = 60);

/// Held against what RawCurve promises; sets `error` where it is not so.
void check_curve(RawCurve& curve);

/// Splits a curve that was recorded in one piece at the end of its approach: where z is farthest from where
/// it began.
void split_at_turn(const std::vector<double>& z, const std::vector<double>& deflection, RawCurve& curve);

}  // namespace telenano::fit

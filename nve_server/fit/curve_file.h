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
};

/// By what the bytes begin with: zip (.jpk-force), Igor 5 (.ibw), else text (.csv).
RawCurve read_curve(std::string_view bytes, const ColumnChoice& columns = {});

/// A table with commas, semicolons or tabs. The header is the first line that is followed by a line of as
/// many numbers; what stands before it is passed over, and lines with '#'. A column's unit stands in its
/// name: "z_nm", "Extend Force(nN)", "deflection [V]". Units: m, um, nm, pm; N, uN, nN, pN; V, mV. Ways: a
/// column "direction" (approach, retract), or columns of their own ("Extend …", "Retract …"), else the
/// turning point. What `telenano-nve curve` prints is such a table.
RawCurve read_csv(std::string_view bytes, const ColumnChoice& columns = {});

/// Igor binary wave, version 5, with columns Defl and ZSnsr or Raw in metres, as Asylum's instruments write
/// it (WaveMetrics, Technical Note 003, "Igor Binary Format"; its note has the lever and the turning point).
RawCurve read_ibw(std::string_view bytes, const ColumnChoice& columns = {});

/// JPK's force file: a zip of .properties and big-endian integers, each channel with its chain of conversions
/// (file format versions 0.x, where each segment has its own).
RawCurve read_jpk(std::string_view bytes, const ColumnChoice& columns = {});

/// One printable line of ASCII of at most `longest` bytes: everything else becomes '?'.
std::string plain_line(std::string_view text, std::size_t longest = 60);

/// Held against what RawCurve promises; sets `error` where it is not so.
void check_curve(RawCurve& curve);

/// Splits a curve that was recorded in one piece at the end of its approach: where z is farthest from where
/// it began.
void split_at_turn(const std::vector<double>& z, const std::vector<double>& deflection, RawCurve& curve);

}  // namespace telenano::fit

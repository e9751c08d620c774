#!/usr/bin/env bash
# Draws the heights of a .gsf scan (what telenano-nve trace --save-surface writes) with gnuplot.
source "$(dirname "${BASH_SOURCE[0]}")/lib.sh"
usage() {
  cat <<'H'
usage: deploy/draw_surface.sh FILE.gsf OUT.png
  The picture of the example:
    telenano-nve trace --scene deploy/scenes/lithography.toml --path deploy/scenes/lithography_path.csv \
      --csv forces.csv --save-surface marks.gsf && deploy/draw_surface.sh marks.gsf deploy/pictures/lithography.png
H
}
case ${1:-} in -h|--help) usage; exit 0 ;; esac
[ $# = 2 ] || { usage >&2; exit 1; }
command -v gnuplot >/dev/null || die "gnuplot is missing (Debian: gnuplot-nox)" 2
[ -r "$1" ] || die "$1 cannot be read"
# The header is lines "name = value" up to a NUL byte; after it come XRes * YRes float32 and nothing else.
header=$(head -c 4096 -- "$1" | tr '\0' '\n' | LC_ALL=C grep -a -E '^(Gwyddion|X|Y|Title)' || true)
value() { printf '%s\n' "$header" | LC_ALL=C sed -n "s/^$1 *= *//p" | head -n 1; }
case $header in 'Gwyddion Simple Field 1.0'*) ;; *) die "$1 is not a Gwyddion Simple Field" ;; esac
columns=$(value XRes) rows=$(value YRes) width=$(value XReal) height=$(value YReal) x=$(value XOffset) y=$(value YOffset)
for number in "$columns" "$rows"; do case $number in ''|*[!0-9]*) die "$1 has no XRes or YRes" ;; esac; done
[ -n "$width" ] && [ -n "$height" ] || die "$1 has no XReal or YReal"
skip=$(($(wc -c <"$1") - 4 * columns * rows))
[ "$skip" -gt 0 ] || die "$1 is cut short"
GSF=$1 PNG=$2 gnuplot <<G || die "gnuplot could not draw $1"
set terminal pngcairo size 1000, 820 font "sans,14" linewidth 1.5
set output system("printf %s \"\$PNG\"")
set size ratio -1
set xlabel "x (nm)"
set ylabel "y (nm)"
set cblabel "height (nm)"
set palette cubehelix start 0.5 cycles -1 saturation 1
set xrange [${x:-0}*1e9 : (${x:-0} + $width)*1e9]
set yrange [${y:-0}*1e9 : (${y:-0} + $height)*1e9]
nx = 1e9*$width/$columns
ny = 1e9*$height/$rows
plot system("printf %s \"\$GSF\"") binary array=($columns,$rows) skip=$skip format='%float' endian=little \
  dx=nx dy=ny flipy origin=(${x:-0}*1e9 + nx/2, ${y:-0}*1e9 + ny/2) using (1e9*\$1) with image notitle
G

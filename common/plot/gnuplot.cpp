#include "telenano/common/plot/gnuplot.h"

#include <fmt/format.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "telenano/common/base/error.h"

namespace telenano::plot {
namespace {

constexpr const char* kStyle = R"(set datafile separator ','
set encoding utf8
set border 3 lc rgb '#666666' lw 1
set tics nomirror out scale 0.6 textcolor rgb '#333333'
set grid lc rgb '#E4E4E4' lt 1 lw 1
set key top right Right samplen 1.6 spacing 1.15 noenhanced textcolor rgb '#222222'
set style data lines
set style fill solid 0.5 noborder
set bmargin 0
set tmargin 0
)";

}  // namespace

std::string common_style() {
  return kStyle;
}

std::string quoted(const std::string& text) {
  std::string result = "'";
  for (const char c : text) {
    if (c == '\'') result += '\'';
    result += c == '\n' ? ' ' : c;
  }
  return result + "'";
}

bool has_gnuplot() {
  return std::system("gnuplot --version >/dev/null 2>&1") == 0;
}

void require_drawable(const std::string& file, const std::string& flag) {
  if (!file.ends_with(".svg") && !file.ends_with(".png"))
    throw UserError(flag + " " + file + ": expected a name that ends in .svg or .png");
  if (!has_gnuplot())
    throw RunError(flag + " " + file + ": gnuplot is not installed (apt install gnuplot-nox)");
  const bool existed = std::filesystem::exists(file);
  if (!std::ofstream(file, std::ios::app).good()) throw UserError(flag + " " + file + ": cannot be written");
  std::error_code error;
  if (!existed) std::filesystem::remove(file, error);
}

void draw(const std::string& file, int width, int height, const std::string& script) {
  std::FILE* pipe = popen("gnuplot >/dev/null 2>&1", "w");
  if (pipe == nullptr) throw RunError(file + ": gnuplot cannot be started");
  const std::string whole = fmt::format(
      "set terminal {} size {},{} font 'Helvetica,Arial,sans-serif,12' background '#FFFFFF'\n"
      "set output {}\n{}{}",
      file.ends_with(".png") ? "pngcairo" : "svg dynamic", width, height, quoted(file), common_style(),
      script);
  std::fwrite(whole.data(), 1, whole.size(), pipe);
  if (pclose(pipe) != 0) throw RunError(file + ": gnuplot failed");
}

}  // namespace telenano::plot

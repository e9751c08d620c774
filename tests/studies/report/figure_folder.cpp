#include "tests/studies/report/figure_folder.h"

#include <cstdlib>
#include <fstream>
#include <iterator>
#include <string_view>

#include "telenano/common/base/error.h"
#include "tests/studies/report/gnuplot.h"

namespace telenano::studies {
namespace {

/// An argument for the shell.
std::string shell_quoted(const std::string& text) {
  std::string result = "'";
  for (const char c : text) result += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return result + "'";
}

std::string slurp(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

}  // namespace

FigureFolder::FigureFolder(std::filesystem::path folder)
    : folder_(std::move(folder)), has_gnuplot_(plot::has_gnuplot()) {
  std::error_code error;
  std::filesystem::create_directories(folder_, error);
  if (error) throw UserError(folder_.string() + ": cannot be created: " + error.message());
  // A study may compute for minutes before its first file: what cannot be written is said at once.
  const std::filesystem::path probe = folder_ / ".writable";
  const bool writable = std::ofstream(probe).good();
  std::filesystem::remove(probe, error);
  if (!writable) throw UserError(folder_.string() + ": nothing can be written there");
}

void FigureFolder::write(const std::string& file, const std::string& text) const {
  std::ofstream out(folder_ / file, std::ios::binary);
  out << text;
  if (!out.flush()) throw RunError((folder_ / file).string() + ": cannot be written");
}

void FigureFolder::draw(Figure& figure, int width, int height, const std::string& script) const {
  const std::string name = figure.id + ".gp";
  write(name, style(figure.id, width, height) + script);
  if (!has_gnuplot_) return;
  const std::string command =
      "cd " + shell_quoted(folder_.string()) + " && gnuplot " + shell_quoted(name) + " 1>&2";
  if (std::system(command.c_str()) != 0) throw RunError((folder_ / name).string() + ": gnuplot failed");
  std::string svg = slurp(folder_ / (figure.id + ".svg"));
  // Inside a page there is no prolog.
  const auto begin = svg.find("<svg");
  figure.svg = begin == std::string::npos ? "" : svg.substr(begin);
  static constexpr std::string_view kCanvas =
      "id=\"gnuplot_canvas\"";  // the same in every figure: once a page only
  const auto canvas = figure.svg.find(kCanvas);
  if (canvas != std::string::npos) figure.svg.replace(canvas, kCanvas.size(), "class=\"canvas\"");
}

}  // namespace telenano::studies

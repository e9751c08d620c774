#pragma once

#include <filesystem>
#include <string>

namespace telenano::studies {

/// A figure of a page: caption and the SVG text, empty when gnuplot could not draw it.
struct Figure {
  std::string id;
  std::string title;
  std::string caption;
  std::string svg;
};

/// The folder in which gnuplot draws: CSV files, one script a figure, the SVG. All of it stays, so that any
/// figure can be drawn again by hand: `cd folder && gnuplot NAME.gp`.
class FigureFolder {
 public:
  /// Creates the folder; throws UserError if that is not possible or if nothing can be written into it.
  explicit FigureFolder(std::filesystem::path folder);

  bool has_gnuplot() const noexcept { return has_gnuplot_; }
  const std::filesystem::path& path() const noexcept { return folder_; }
  void write(const std::string& file, const std::string& text) const;
  /// Draws with `script` after the common style; the SVG goes into the figure.
  void draw(Figure& figure, int width, int height, const std::string& script) const;

 private:
  std::filesystem::path folder_;
  bool has_gnuplot_ = false;
};

}  // namespace telenano::studies

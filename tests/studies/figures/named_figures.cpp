#include "tests/studies/figures/named_figures.h"

#include <algorithm>
#include <cstdio>

#include "common/base/error.h"
#include "common/base/version.h"
#include "tests/studies/figures/ks06.h"
#include "tests/studies/figures/ks18.h"
#include "tests/studies/report/page.h"

namespace telenano::studies {
namespace {

constexpr NamedFigure kFigures[] = {
    {"ks06", "Kim & Sitti, fig. 6: force against distance, approach and retract", draw_ks06},
    {"ks18", "Kim & Sitti, fig. 18: forces at the hand between tasks", draw_ks18},
};

}  // namespace

std::span<const NamedFigure> named_figures() {
  return kFigures;
}

void draw_figures(const std::vector<std::string>& only, const std::filesystem::path& out) {
  std::string names;
  for (const NamedFigure& figure : kFigures) names += (names.empty() ? "" : ", ") + std::string(figure.name);
  for (const std::string& name : only) {
    if (std::none_of(std::begin(kFigures), std::end(kFigures),
                     [&](const NamedFigure& f) { return name == f.name; }))
      throw UserError("figures: --only: '" + name + "' is unknown; expected some of " + names);
  }
  const FigureFolder folder(out);
  std::string html = page_begin("Figures of the source papers", std::string("commit ") + kGitCommit);
  if (!folder.has_gnuplot()) {
    std::fprintf(stderr, "figures: gnuplot is not installed: CSV only\n");
    html +=
        "<p class=\"note\">gnuplot is not installed, so there are no figures; the numbers are in the CSV "
        "files.</p>\n";
  }
  for (const NamedFigure& named : kFigures) {
    if (!only.empty() && std::find(only.begin(), only.end(), named.name) == only.end()) continue;
    std::fprintf(stderr, "figures: %s ...\n", named.name);
    Figure figure = named.draw(folder);
    html += "<h2>" + html_escaped(named.title) + "</h2>\n" + figure_html(figure);
  }
  folder.write("index.html", html + page_end());
  std::printf("figures: %s\n", (out / "index.html").c_str());
}

}  // namespace telenano::studies

#include "tests/studies/figures/named_figures.h"

#include <algorithm>
#include <cstdio>

#include "telenano/common/base/error.h"
#include "telenano/common/base/version.h"
#include "tests/studies/figures/ks06.h"
#include "tests/studies/figures/ks13.h"
#include "tests/studies/figures/ks16.h"
#include "tests/studies/figures/ks18.h"
#include "tests/studies/figures/scaling_figures.h"
#include "tests/studies/report/page.h"
#include "tests/studies/report/paper_table.h"
#include "tests/studies/zwidth/zwidth_figures.h"

namespace telenano::studies {
namespace {

constexpr NamedFigure kFigures[] = {
    {"ks06", "Kim & Sitti, fig. 6: force against distance, approach and retract", draw_ks06},
    {"ks11", "Kim & Sitti, fig. 11: Z-width with the force scaling factor", draw_ks11},
    {"ks12", "Kim & Sitti, fig. 12: region of the force scaling factor", draw_ks12},
    {"ks13", "Kim & Sitti, fig. 13: silicon oxide without a passivity controller", draw_ks13},
    {"ks14", "Kim & Sitti, fig. 14: silicon oxide with a passivity controller", draw_ks14},
    {"ks16", "Kim & Sitti, fig. 16: in contact and indenting", draw_ks16},
    {"ks17", "Kim & Sitti, fig. 17: contact on silicon oxide", draw_ks17},
    {"ks18", "Kim & Sitti, fig. 18: forces at the hand between tasks", draw_ks18},
    {"cb03", "Colgate & Brown, fig. 3: stable and unstable interaction with a virtual wall", draw_cb03},
    {"cb04a", "Colgate & Brown, fig. 4a: fine encoder, no filter",
     [](const FigureFolder& folder) { return draw_cb04('a', folder); }},
    {"cb04b", "Colgate & Brown, fig. 4b: coarse encoder, no filter",
     [](const FigureFolder& folder) { return draw_cb04('b', folder); }},
    {"cb04c", "Colgate & Brown, fig. 4c: fine encoder, filter",
     [](const FigureFolder& folder) { return draw_cb04('c', folder); }},
    {"cb04d", "Colgate & Brown, fig. 4d: coarse encoder, filter",
     [](const FigureFolder& folder) { return draw_cb04('d', folder); }},
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
  html +=
      "<p>Under each figure: what the paper says of it, beside what comes out here. Numbers of the papers "
      "are as "
      "printed in their text and tables; the axes of their plots are not in the text that we have, so a "
      "curve's own "
      "values are read off nowhere, and the row says so.</p>\n";
  for (const NamedFigure& named : kFigures) {
    if (!only.empty() && std::find(only.begin(), only.end(), named.name) == only.end()) continue;
    std::fprintf(stderr, "figures: %s ...\n", named.name);
    Figure figure = named.draw(folder);
    html += "<h2>" + html_escaped(named.title) + "</h2>\n" + figure_html(figure) +
            beside_paper_html(folder, figure.id);
  }
  folder.write("index.html", html + page_end());
  std::printf("figures: %s\n", (out / "index.html").c_str());
}

}  // namespace telenano::studies

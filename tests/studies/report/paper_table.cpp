#include "tests/studies/report/paper_table.h"

#include <fstream>
#include <iterator>

#include "tests/studies/report/page.h"

namespace telenano::studies {
namespace {

constexpr const char* kHead = "what,paper,off_by,where,ours,difference";

std::string quoted_cell(const std::string& text) {
  std::string cell = "\"";
  for (const char c : text) cell += c == '"' ? std::string("\"\"") : std::string(1, c);
  return cell + "\"";
}

/// The cells of what write_beside_paper wrote: all of them quoted, rows ended by a newline.
std::vector<std::vector<std::string>> cells_of(const std::string& text) {
  std::vector<std::vector<std::string>> rows(1);
  bool inside = false;
  std::string cell;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (inside && c == '"' && i + 1 < text.size() && text[i + 1] == '"') {
      cell += text[++i];
    } else if (c == '"') {
      inside = !inside;
    } else if (!inside && (c == ',' || c == '\n')) {
      rows.back().push_back(cell);
      cell.clear();
      if (c == '\n') rows.emplace_back();
    } else {
      cell += c;
    }
  }
  rows.pop_back();
  return rows;
}

}  // namespace

void write_beside_paper(const FigureFolder& folder, const std::string& id,
                        const std::vector<BesidePaper>& rows) {
  std::string csv = std::string(kHead) + "\n";
  for (const BesidePaper& row : rows) {
    const std::string* const cells[] = {&row.what,  &row.paper, &row.off_by,
                                        &row.where, &row.ours,  &row.difference};
    std::string line;
    for (const std::string* const cell : cells) line += (line.empty() ? "" : ",") + quoted_cell(*cell);
    csv += line + "\n";
  }
  folder.write(id + ".paper.csv", csv);
}

std::string beside_paper_html(const FigureFolder& folder, const std::string& id) {
  std::ifstream in(folder.path() / (id + ".paper.csv"), std::ios::binary);
  if (!in) return "";
  const std::string text{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  std::string html =
      "<table>\n<tr><th>what</th><th>the paper</th><th>read to</th><th>where</th><th>here</th>"
      "<th>difference</th></tr>\n";
  const auto rows = cells_of(text);
  for (std::size_t i = 1; i < rows.size(); ++i) {
    html += "<tr>";
    for (const std::string& cell : rows[i]) html += "<td>" + html_escaped(cell) + "</td>";
    html += "</tr>\n";
  }
  return html + "</table>\n";
}

}  // namespace telenano::studies

#include "tests/studies/report/page.h"

#include <cstdio>
#include <cstdlib>
#include <functional>

#include "telenano/common/recording/summary.h"

namespace telenano::studies {
namespace {

constexpr const char* kHead = R"(<style>
  :root { color-scheme: light; }
  body { margin: 0 auto; padding: 2rem 1.5rem 4rem; max-width: 66rem; color: #1d2329; background: #fff;
         font: 16px/1.5 system-ui, "Helvetica Neue", Arial, sans-serif; }
  h1 { font-size: 1.7rem; margin: 0 0 .3rem; }
  h2 { font-size: 1.2rem; margin: 2.6rem 0 .6rem; padding-top: .8rem; border-top: 1px solid #dfe3e6; }
  h3 { font-size: 1rem; margin: 1.6rem 0 .3rem; }
  p.lead { color: #55606a; margin: 0; }
  p.note { background: #fff6e0; border-left: 4px solid #e69f00; padding: .5rem .8rem; }
  .scroll { overflow-x: auto; }
  table { border-collapse: collapse; font-size: .88rem; font-variant-numeric: tabular-nums; }
  th, td { text-align: left; padding: .3rem .9rem .3rem 0; border-bottom: 1px solid #e8ebed; vertical-align: top;
           white-space: nowrap; }
  thead th { border-bottom: 2px solid #9aa4ac; }
  tbody th { font-weight: 500; color: #444d55; }
  figure { margin: 0 0 1.6rem; }
  figure svg { width: 100%; height: auto; display: block; }
  figcaption { font-size: .88rem; color: #55606a; max-width: 54rem; }
  details { margin: .5rem 0; }
  pre { background: #f5f7f8; padding: .7rem; overflow: auto; font-size: .8rem; max-height: 24rem; }
</style>
)";

std::string summary_table(const std::vector<RunData>& runs) {
  std::string html = "<div class=\"scroll\"><table>\n<thead><tr><th></th>";
  std::vector<std::vector<std::pair<std::string, std::string>>> columns;
  for (const RunData& run : runs) {
    html += "<th>" + html_escaped(run.label) + "</th>";
    columns.push_back(recording::summary_lines(run.summary));
  }
  html += "</tr></thead>\n<tbody>\n";
  for (std::size_t row = 0; !columns.empty() && row < columns.front().size(); ++row) {
    html += "<tr><th>" + html_escaped(columns.front()[row].first) + "</th>";
    for (const auto& column : columns) html += "<td>" + html_escaped(column[row].second) + "</td>";
    html += "</tr>\n";
  }
  return html + "</tbody></table></div>\n";
}

std::string provenance(const std::vector<RunData>& runs) {
  std::string html;
  for (const RunData& run : runs) {
    html += "<details><summary>" + html_escaped(run.label) + " — " +
            html_escaped(run.path.filename().string()) + "</summary>\n<div class=\"scroll\"><table>\n";
    std::string long_texts;
    for (const auto& [key, text] : run.configuration) {
      if (text.find('\n') == std::string::npos && text.size() < 200) {
        html += "<tr><th>" + html_escaped(key) + "</th><td>" + html_escaped(text) + "</td></tr>\n";
      } else {
        long_texts += "<h3>" + html_escaped(key) + "</h3><pre>" + html_escaped(text) + "</pre>\n";
      }
    }
    html += "</table></div>\n" + long_texts + "</details>\n";
  }
  return html;
}

/// A number from the configuration as a person writes it: there it has 17 digits.
std::string short_number(const std::string& text) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (text.empty() || *end != '\0') return text;
  char buffer[32];
  std::snprintf(buffer, sizeof buffer, "%.4g", value);
  return buffer;
}

/// What was run: of every recording what one must know to run it again.
std::string what_was_run(const std::vector<RunData>& runs) {
  struct Line {
    const char* name;
    std::function<std::string(const RunData&)> text;
  };
  const auto key = [](const char* name) { return [name](const RunData& run) { return run.about(name); }; };
  const auto number = [](const char* name, const char* unit = "") {
    return [name, unit](const RunData& run) {
      const std::string text = short_number(run.about(name));
      return text.empty() ? text : text + unit;
    };
  };
  const std::vector<Line> lines{
      {"scene",
       [](const RunData& run) {
         const std::string hash = run.about("scene_hash");
         return run.about("scene_name") + (hash.empty() ? "" : " (" + hash + ")");
       }},
      {"task", key("task")},
      {"method",
       [](const RunData& run) {
         const std::string method = run.about("control.method");
         return method.empty() ? run.about("method") : method;
       }},
      {"rate", number("rate_hz", " Hz")},
      {"scale of motion α_v", number("scaling.velocity")},
      {"scale of force α_F", number("scaling.force")},
      {"beyond the passive scaling",
       [](const RunData& run) {
         const std::string allowed = run.about("allow_unsafe_scaling");
         return allowed.empty() ? allowed : std::string(allowed == "true" ? "allowed" : "no");
       }},
      {"program",
       [](const RunData& run) {
         const std::string commit = run.about("git_commit");
         return run.about("program") + (commit.empty() ? "" : ", commit " + commit.substr(0, 12));
       }},
      {"protocol", key("protocol_version")},
      {"begun", key("start_time_utc")},
  };
  std::string html = "<div class=\"scroll\"><table>\n<thead><tr><th></th>";
  for (const RunData& run : runs) html += "<th>" + html_escaped(run.label) + "</th>";
  html += "</tr></thead>\n<tbody>\n";
  for (const Line& line : lines) {
    std::string cells;
    bool said = false;
    for (const RunData& run : runs) {
      const std::string text = line.text(run);
      said = said || !text.empty();
      cells += "<td>" + html_escaped(text) + "</td>";
    }
    if (said) html += std::string("<tr><th>") + line.name + "</th>" + cells + "</tr>\n";
  }
  html += "</tbody></table></div>\n";
  std::string commands;
  for (const RunData& run : runs) {
    const std::string command = run.about("command_line");
    if (!command.empty()) commands += "# " + run.label + "\n" + command + "\n";
  }
  if (!commands.empty())
    html += "<details><summary>command lines</summary><pre>" + html_escaped(commands) + "</pre></details>\n";
  return html;
}

}  // namespace

std::string html_escaped(const std::string& text) {
  std::string result;
  for (const char c : text) {
    switch (c) {
      case '&':
        result += "&amp;";
        break;
      case '<':
        result += "&lt;";
        break;
      case '>':
        result += "&gt;";
        break;
      case '"':
        result += "&quot;";
        break;
      default:
        result += c;
    }
  }
  return result;
}

std::string page_begin(const std::string& title, const std::string& lead) {
  return "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
         "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>" +
         html_escaped(title) + "</title>\n" + kHead + "</head>\n<body>\n<h1>" + html_escaped(title) +
         "</h1>\n<p class=\"lead\">" + html_escaped(lead) + "</p>\n";
}

std::string figure_html(const Figure& figure) {
  return "<figure id=\"" + figure.id + "\">\n" + figure.svg + "\n<figcaption>" +
         html_escaped(figure.caption) + "</figcaption>\n</figure>\n";
}

std::string page_end() {
  return "</body>\n</html>\n";
}

std::string make_page(const std::string& title, const std::vector<RunData>& runs,
                      const std::vector<Figure>& figures, const std::string& note) {
  const std::string started = runs.empty() ? "" : runs.front().about("start_time_utc");
  std::string html =
      page_begin(title, std::to_string(runs.size()) + " recording" + (runs.size() == 1 ? "" : "s") +
                            (started.empty() ? "" : ", the first begun " + started));
  if (!note.empty()) html += "<p class=\"note\">" + html_escaped(note) + "</p>\n";
  html += "<h2>What was run</h2>\n" + what_was_run(runs);
  html += "<h2>Summary</h2>\n" + summary_table(runs);
  std::string last_title;
  for (const Figure& figure : figures) {
    if (figure.title != last_title) html += "<h2>" + html_escaped(figure.title) + "</h2>\n";
    last_title = figure.title;
    html += figure_html(figure);
  }
  html +=
      "<h2>Where these figures come from</h2>\n"
      "<p class=\"lead\">The folder <code>data</code> beside this page holds every curve as CSV and every "
      "figure's "
      "gnuplot script. The recordings carry their whole configuration:</p>\n" +
      provenance(runs);
  return html + page_end();
}

}  // namespace telenano::studies

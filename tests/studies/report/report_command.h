#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace CLI {
class App;
}

namespace telenano::studies {

struct ReportRequest {
  std::string title = "Telenano session";
  std::filesystem::path out = "report";
  std::vector<std::pair<std::string, std::filesystem::path>> runs;  ///< label, recording
  /// Without and with control; both or none.
  std::vector<std::pair<std::string, std::filesystem::path>> pair;
};

/// Writes out/index.html and out/data/*; returns the summaries as text. Throws UserError for wrong input and
/// RunError when the output cannot be written. Without gnuplot the page has no figures and says so.
std::string make_report(const ReportRequest& request);

/// `telenano-lab report --out DIR --run LABEL=FILE ... [--pair LABEL=FILE LABEL=FILE] [--title TEXT]`
void add_report_command(CLI::App& app);

}  // namespace telenano::studies

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
  /// Two or three of the same task, side by side: without control first. A file may be among the runs too.
  std::vector<std::pair<std::string, std::filesystem::path>> pair;
  std::filesystem::path curve{};  ///< what telenano-nve curve printed; empty for none
};

/// Writes out/index.html and out/data/*; returns the summaries as text. Throws UserError for wrong input and
/// RunError when the output cannot be written. Without gnuplot the page has no figures and says so.
std::string make_report(const ReportRequest& request);

/// `telenano-lab report --out DIR --run LABEL=FILE ... [--pair LABEL=FILE ...] [--curve FILE]
/// [--title TEXT]`
void add_report_command(CLI::App& app);

}  // namespace telenano::studies

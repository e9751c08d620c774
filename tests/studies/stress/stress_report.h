#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "tests/studies/stress/table.h"

namespace telenano::studies::stress {

struct ReportOptions {
  std::filesystem::path folder;  ///< of the sweep: the report goes into folder/report
  std::filesystem::path scenes;
  std::string manifest;
  bool sample = false;  ///< the runs are independent draws: the page has the rate of each method and feature
};

/// The command that runs it again.
std::string replay_command(const RunSpec& spec);

/// Processor, cores and system of this machine, one line.
std::string machine_text();

/// A row a method: runs, broken promises, what was extracted at most, what can be said with confidence.
std::string summary_csv(const std::vector<Row>& rows);

/// report/index.html, self-contained, and under report/data what its figures are made of.
void write_report(const ReportOptions& options, const std::vector<Row>& rows);

}  // namespace telenano::studies::stress

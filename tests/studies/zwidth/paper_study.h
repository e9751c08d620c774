#pragma once

#include <string>
#include <vector>

#include "tests/studies/zwidth/zwidth_study.h"

namespace telenano::studies {

/// One of CB's sixteen configurations: mechanical damper in or out, 1 kHz or 100 Hz, 8 000 or 900 000 counts
/// a turn of a crank of 0.15 m, velocity filtered at 30 Hz or not; 12-bit force command. The paper's mass and
/// damping are not legible: 2 kg, and 2 N·s/m without or 20 N·s/m with the damper, are assumed.
struct PaperConfiguration {
  bool damper = false;
  bool fast = false;
  bool fine = false;
  bool filtered = false;

  std::string name() const;  ///< e.g. "damper-1000Hz-8000-unfiltered"
  ZWidthOptions options() const;
  double velocity_resolution_m_s() const;  ///< q/T, with the filter q/(T + τ)
};
std::vector<PaperConfiguration> paper_configurations();

/// Rows of each configuration into `folder`/zwidth.csv, over virtual dampings from 0 to where nothing is
/// stable; what is there already is not computed again. Progress on standard error. Throws UserError if the
/// folder cannot be written.
void run_paper_study(const std::string& folder);

struct PaperRow {
  PaperConfiguration configuration;
  ZWidthRow values;
};
/// What run_paper_study wrote, each configuration by rising damping. Throws UserError for a line that it did
/// not write.
std::vector<PaperRow> read_paper_study(const std::string& folder);

}  // namespace telenano::studies

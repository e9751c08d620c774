#pragma once

#include "tests/studies/precision/work_precision.h"

/// The parts of `telenano-lab precision`; each measures, draws into `folder` and explains its choice.
namespace telenano::studies {

Section law_section(const Effort& effort, const FigureFolder& folder);
Section ground_section(const Effort& effort, const FigureFolder& folder);
Section interpolation_section(const Effort& effort, const FigureFolder& folder);
Section coupling_section(const Effort& effort, const FigureFolder& folder);
Section probe_section(const Effort& effort, const FigureFolder& folder);
Section step_section(const Effort& effort, const FigureFolder& folder);
Section wire_section(const Effort& effort, const FigureFolder& folder);

}  // namespace telenano::studies

#pragma once

#include <string>

namespace telenano::studies::stress {

/// The real programs (telenano-nve serve with keys, telenano-master run) over DTLS through a relay with delay,
/// jitter, loss and an outage, under hands that press, hammer and scrub, beside busy loops that want every
/// core; and the same session in virtual time. CSV on standard output, a line for each metric of each case. 1
/// where a metric is further off than is said there, or an invariant is violated in the recording; else 0.
/// `brief`: two short cases.
int check_real_programs(const std::string& scene_folder, bool brief);

}  // namespace telenano::studies::stress

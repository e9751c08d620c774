#pragma once

#include <string>
#include <vector>

#include "telenano/common/recording/recorder.h"
#include "telenano/common/recording/summary.h"
#include "telenano/common/rt/periodic_timer.h"
#include "telenano/master/app/run/real_time_session.h"

namespace telenano::app {

// What a session tells a person, on standard error.

/// One line; on a terminal over the last one. `duration_s` 0: no end in sight.
void print_progress(const Progress& p, double duration_s, bool terminal);

/// What has changed of a shared tip and of the server, a line each.
void print_changes(const Progress& before, const Progress& now, bool terminal);

/// What the bits of a recording's faults are called, the lowest first, "; " between them.
std::string slave_fault_names();
std::string station_fault_names();

/// One line at the end: how many datagrams a second at last, at least, and why.
void print_sending(const Progress& last);
/// What a window that stays says: the failure, or that all went well, and what was felt; a line each.
std::vector<std::string> end_lines(const std::string& failure, recording::Summary summary);

/// At the end. `recorder` may be null. Overruns and missed ticks are the timer's: it knows them for certain.
void print_summary(recording::Summary summary, const rt::PeriodicTimerStats& timer,
                   const recording::Recorder* recorder, const std::string& path);

}  // namespace telenano::app

#pragma once

#include <string>

#include "telenano/common/link/client_session.h"
#include "telenano/master/app/run/real_time_session.h"
#include "telenano/master/app/run/run_options.h"
#include "telenano/master/connection/server_link.h"
#include "telenano/master/station/station.h"

namespace telenano::app {

/// What ended the session, in one line; empty: its task, or its operator.
std::string failure_text(const RealTimeSession& live, const station::Station& station,
                         const link::ClientSession& session, const RunOptions& options,
                         const connection::ServerLink& way, double rate_hz);

}  // namespace telenano::app

#pragma once

#include "telenano/common/metrics/page.h"
#include "telenano/master/app/run/real_time_session.h"

namespace telenano::app {

/// What a scrape of the station is answered with: what the loop has published.
void write_metrics(const Progress& progress, metrics::Page& page);

}  // namespace telenano::app

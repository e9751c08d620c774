// A build without prometheus-cpp: the flag is there, and says what is missing.
#include "telenano/common/base/error.h"
#include "telenano/common/metrics/exporter.h"

namespace telenano::metrics {

struct Exporter::Impl {};

Exporter::Exporter(const std::string&, bool, std::function<void(Page&)>, std::vector<TextPage>) {
  throw UserError(
      "--metrics: this build has no metrics; build with -DTELENANO_METRICS=ON and the package "
      "prometheus-cpp-dev");
}

Exporter::~Exporter() = default;

}  // namespace telenano::metrics

#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "telenano/common/metrics/page.h"
#include "telenano/common/metrics/text_page.h"

namespace telenano::metrics {

/// Answers Prometheus: GET /metrics over HTTP, on threads of its own (signals blocked). `fill` writes the
/// page for each scrape, in one of them: let it read atomics and LatestValues only. `pages` are answered at
/// the same address.
class Exporter {
 public:
  /// `address` HOST:PORT. Throws UserError, one line that names --metrics: not an address, not of this
  /// machine's loopback unless `anybody` may ask, taken by another program, or a build without metrics.
  Exporter(const std::string& address, bool anybody, std::function<void(Page&)> fill,
           std::vector<TextPage> pages = {});
  ~Exporter();
  Exporter(const Exporter&) = delete;
  Exporter& operator=(const Exporter&) = delete;

  /// Where it listens, e.g. http://127.0.0.1:9464/metrics.
  const std::string& url() const noexcept { return url_; }

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
  std::string url_;
};

}  // namespace telenano::metrics

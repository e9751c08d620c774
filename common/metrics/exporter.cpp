#include "common/metrics/exporter.h"

#include <pthread.h>
#include <signal.h>

#include <exception>
#include <limits>

#include <prometheus/collectable.h>
#include <prometheus/exposer.h>
#include <prometheus/metric_family.h>

#include "common/base/error.h"
#include "common/net/udp.h"

namespace telenano::metrics {
namespace {

prometheus::ClientMetric metric_of(const Page::Series& series, Page::Kind kind) {
  prometheus::ClientMetric metric;
  for (const auto& [name, value] : series.labels) metric.label.push_back({name, value});
  switch (kind) {
    case Page::Kind::kCounter:
      metric.counter.value = series.value;
      break;
    case Page::Kind::kGauge:
      metric.gauge.value = series.value;
      break;
    case Page::Kind::kHistogram: {
      std::uint64_t cumulative = 0;
      for (std::size_t i = 0; i < series.bucket_counts.size(); ++i) {
        cumulative += series.bucket_counts[i];
        const double bound =
            i < series.upper_bounds.size() ? series.upper_bounds[i] : std::numeric_limits<double>::infinity();
        metric.histogram.bucket.push_back({cumulative, bound});
      }
      metric.histogram.sample_count = cumulative;
      metric.histogram.sample_sum = series.sum;
      break;
    }
  }
  return metric;
}

prometheus::MetricType type_of(Page::Kind kind) {
  switch (kind) {
    case Page::Kind::kCounter:
      return prometheus::MetricType::Counter;
    case Page::Kind::kHistogram:
      return prometheus::MetricType::Histogram;
    case Page::Kind::kGauge:
      break;
  }
  return prometheus::MetricType::Gauge;
}

/// Values are made when they are asked for: no registry that a loop would have to lock.
class Collected final : public prometheus::Collectable {
 public:
  explicit Collected(std::function<void(Page&)> fill) : fill_(std::move(fill)) {}
  std::vector<prometheus::MetricFamily> Collect() const override {
    Page page;
    fill_(page);
    std::vector<prometheus::MetricFamily> families;
    for (const Page::Family& from : page.families()) {
      prometheus::MetricFamily& family = families.emplace_back();
      family.name = from.name;
      family.help = from.help;
      family.type = type_of(from.kind);
      for (const Page::Series& series : from.series) family.metric.push_back(metric_of(series, from.kind));
    }
    return families;
  }

 private:
  std::function<void(Page&)> fill_;
};

/// The server's threads are made with all signals blocked: those that end the program go to its own.
class SignalsBlocked {
 public:
  SignalsBlocked() {
    sigset_t all;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before_);
  }
  ~SignalsBlocked() { pthread_sigmask(SIG_SETMASK, &before_, nullptr); }
  SignalsBlocked(const SignalsBlocked&) = delete;
  SignalsBlocked& operator=(const SignalsBlocked&) = delete;

 private:
  sigset_t before_{};
};

}  // namespace

struct Exporter::Impl {
  std::shared_ptr<Collected> collected;
  std::unique_ptr<prometheus::Exposer> exposer;
};

Exporter::Exporter(const std::string& address, bool anybody, std::function<void(Page&)> fill)
    : impl_(std::make_unique<Impl>()) {
  net::Address at = net::parse_address(address, "--metrics");
  if (!net::is_loopback(at) && !anybody) {
    throw UserError(
        "--metrics " + address +
        ": off loopback anybody who reaches the port can read it, unencrypted; give --metrics-public "
        "too if that is meant, or 127.0.0.1:PORT");
  }
  impl_->collected = std::make_shared<Collected>(std::move(fill));
  const SignalsBlocked blocked;
  try {
    impl_->exposer = std::make_unique<prometheus::Exposer>(net::to_string(at), 1);
  } catch (const std::exception&) {
    throw UserError(
        "--metrics " + address +
        ": cannot listen there: another program may hold the port (ss -tlpn), or the address is not "
        "this machine's; choose another port");
  }
  impl_->exposer->RegisterCollectable(impl_->collected);
  const auto ports = impl_->exposer->GetListeningPorts();
  if (!ports.empty()) at.port = static_cast<std::uint16_t>(ports.front());
  url_ = "http://" + net::to_string(at) + "/metrics";
}

Exporter::~Exporter() = default;

}  // namespace telenano::metrics

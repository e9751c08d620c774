#include "telenano/common/metrics/exporter.h"

#include <pthread.h>

#include <CivetServer.h>

#include <exception>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include <prometheus/collectable.h>
#include <prometheus/exposer.h>
#include <prometheus/metric_family.h>

#include "telenano/common/base/error.h"
#include "telenano/common/net/udp.h"
#include "telenano/common/rt/signals_blocked.h"

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

/// The server's threads are made with all signals blocked: those that end the program go to its own. And with
/// little stack: a program that keeps all its memory locked has all of it in memory.
class ServingThreads {
 public:
  ServingThreads() {
    changed_ = pthread_getattr_default_np(&stacks_) == 0;
    pthread_attr_t small;
    if (changed_ && pthread_attr_init(&small) == 0) {
      pthread_attr_setstacksize(&small, kStackBytes);
      pthread_setattr_default_np(&small);
      pthread_attr_destroy(&small);
    }
  }
  ~ServingThreads() {
    if (changed_) {
      pthread_setattr_default_np(&stacks_);
      pthread_attr_destroy(&stacks_);
    }
  }
  ServingThreads(const ServingThreads&) = delete;
  ServingThreads& operator=(const ServingThreads&) = delete;

 private:
  static constexpr std::size_t kStackBytes = 512 * 1024;
  rt::SignalsBlocked blocked_{};
  pthread_attr_t stacks_{};
  bool changed_ = false;
};

// Each connection has a thread until its request is there or its time is over, and others wait. Who opens
// connections and says nothing, or says it letter by letter, keeps a thread for kPatience; so a scrape comes
// through at once beside 15 of them, and beside n of them after about n/16 · kPatience: within Prometheus'
// 10 s up to some 150. A scrape's own request is one segment.
constexpr const char* kThreads = "16";
constexpr const char* kPatience = "1000";  // ms

// The library's exposer keeps its server to itself. What it starts tells of itself in the thread that makes
// it.
thread_local mg_context* g_started = nullptr;

CivetCallbacks tell_of_start() {
  CivetCallbacks callbacks;
  callbacks.init_context = [](const mg_context* context) { g_started = const_cast<mg_context*>(context); };
  return callbacks;
}

int answer_text(mg_connection* connection, void* page) {
  TextAnswer answer = static_cast<const TextPage*>(page)->answer();
  answer.text += '\n';
  mg_printf(connection,
            "HTTP/1.1 %d %s\r\nContent-Type: text/plain; charset=utf-8\r\nCache-Control: no-store\r\n"
            "Content-Length: %zu\r\nConnection: close\r\n\r\n",
            answer.status, answer.status == 200 ? "OK" : "Service Unavailable", answer.text.size());
  mg_write(connection, answer.text.data(), answer.text.size());
  return answer.status;
}

}  // namespace

struct Exporter::Impl {
  std::vector<TextPage> pages;  // outlive the threads of the exposer
  std::shared_ptr<Collected> collected;
  std::unique_ptr<prometheus::Exposer> exposer;
};

Exporter::Exporter(const std::string& address, bool anybody, std::function<void(Page&)> fill,
                   std::vector<TextPage> pages)
    : impl_(std::make_unique<Impl>()) {
  net::Address at = net::parse_address(address, "--metrics");
  if (!net::is_loopback(at) && !anybody) {
    throw UserError("--metrics " + address +
                    ": on a non-loopback address anyone who reaches the port can read it, unencrypted; add "
                    "--metrics-public if you want that, or give 127.0.0.1:PORT");
  }
  impl_->collected = std::make_shared<Collected>(std::move(fill));
  impl_->pages = std::move(pages);
  const CivetCallbacks callbacks = tell_of_start();
  const ServingThreads threads;
  try {
    impl_->exposer = std::make_unique<prometheus::Exposer>(
        std::vector<std::string>{"listening_ports", net::to_string(at), "num_threads", kThreads,
                                 "request_timeout_ms", kPatience},
        &callbacks);
  } catch (const std::exception&) {
    throw UserError(
        "--metrics " + address +
        ": cannot listen there: another program may hold the port (ss -tlpn), or the address is not "
        "this machine's; choose another port");
  }
  impl_->exposer->RegisterCollectable(impl_->collected);
  for (TextPage& page : impl_->pages)
    mg_set_request_handler(g_started, page.path.c_str(), answer_text, &page);
  const auto ports = impl_->exposer->GetListeningPorts();
  if (!ports.empty()) at.port = static_cast<std::uint16_t>(ports.front());
  url_ = "http://" + net::to_string(at) + "/metrics";
}

Exporter::~Exporter() = default;

}  // namespace telenano::metrics

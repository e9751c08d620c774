#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace telenano::metrics {

using Labels = std::vector<std::pair<std::string, std::string>>;

/// What one scrape is answered with: families of values, in the order in which they were written. Made anew
/// for each scrape, by the thread that answers it; nothing here is ever touched by a loop.
class Page {
 public:
  enum class Kind : std::uint8_t { kCounter, kGauge, kHistogram };
  struct Series {
    Labels labels;
    double value = 0;
    std::vector<double> upper_bounds;          ///< of a histogram's buckets, without the last, infinite one
    std::vector<std::uint64_t> bucket_counts;  ///< one more than bounds; not cumulative
    double sum = 0;
  };
  struct Family {
    std::string name;
    std::string help;
    Kind kind = Kind::kGauge;
    std::vector<Series> series;
  };

  /// Names as Prometheus wants them: base units in the name, counters end in _total. A name that comes again
  /// adds a series to its family.
  void counter(const char* name, const char* help, double value, Labels labels = {}) {
    add(name, help, Kind::kCounter, {std::move(labels), value, {}, {}, 0});
  }
  void gauge(const char* name, const char* help, double value, Labels labels = {}) {
    add(name, help, Kind::kGauge, {std::move(labels), value, {}, {}, 0});
  }
  void histogram(const char* name, const char* help, std::span<const double> upper_bounds,
                 std::span<const std::uint64_t> bucket_counts, double sum, Labels labels = {}) {
    add(name, help, Kind::kHistogram,
        {std::move(labels),
         0,
         {upper_bounds.begin(), upper_bounds.end()},
         {bucket_counts.begin(), bucket_counts.end()},
         sum});
  }

  const std::vector<Family>& families() const noexcept { return families_; }

 private:
  void add(const char* name, const char* help, Kind kind, Series series) {
    for (Family& family : families_) {
      if (family.name != name) continue;
      family.series.push_back(std::move(series));
      return;
    }
    families_.push_back({name, help, kind, {std::move(series)}});
  }

  std::vector<Family> families_;
};

}  // namespace telenano::metrics

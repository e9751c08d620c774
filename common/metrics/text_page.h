#pragma once

#include <functional>
#include <string>

namespace telenano::metrics {

/// An answer of one short text, for who asks whether something is so: a status of HTTP and a line.
struct TextAnswer {
  int status = 200;  ///< 200 or 503
  std::string text;  ///< without a line feed at its end
};

/// Served beside /metrics, e.g. at "/healthz". `answer` is called for each request, in a thread of the
/// exporter: let it read atomics only.
struct TextPage {
  std::string path;
  std::function<TextAnswer()> answer;
};

}  // namespace telenano::metrics

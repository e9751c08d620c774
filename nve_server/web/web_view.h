#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <string>

#include "telenano/common/surface/height_grid.h"

namespace telenano::web {

struct WebViewConfig {
  std::string address;   ///< HOST:PORT; port 0 takes any free one
  bool anybody = false;  ///< may listen off loopback
  std::size_t clients_max = 8;
  std::string three_js = "/usr/share/javascript/three/three.min.js";
  /// Now; empty: the surface is not known. By the web thread, when a browser asks for it.
  std::function<surface::HeightGrid()> heights;
  std::function<std::string()> state;  ///< one JSON object; called 30 times a second by the web thread
  std::function<void(const std::string&)> tell;  ///< one line for the log; by the web thread
};

/// A read-only view for browsers, in one thread of its own (signals blocked), over HTTP and WebSocket.
///
/// Who may look: the request must name the address that it came to as its Host (so that a foreign name that
/// resolves to this machine gets nothing), an Origin must be the page's own, and the address that is printed
/// holds a token of 128 bits. A token is worth one use: it becomes a cookie of that browser, and the next
/// token is told. So an address that is left in a history or a picture opens nothing, and several people
/// can look. Nothing that a browser says has an effect; any message of it ends its connection.
class WebView {
 public:
  /// Throws UserError, one line that names --web.
  explicit WebView(WebViewConfig config);
  ~WebView();
  WebView(const WebView&) = delete;
  WebView& operator=(const WebView&) = delete;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace telenano::web

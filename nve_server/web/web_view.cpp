#include "telenano/nve_server/web/web_view.h"

#include <ifaddrs.h>
#include <net/if.h>
#include <netinet/in.h>

#include <array>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <cstring>
#include <deque>
#include <fstream>
#include <iterator>
#include <optional>
#include <random>
#include <set>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/net/udp.h"
#include "telenano/common/rt/background.h"
#include "telenano/common/rt/signals_blocked.h"
#include "telenano/nve_server/web/web_page.h"

namespace telenano::web {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using Tcp = asio::ip::tcp;
using Request = http::request<http::empty_body>;
using Response = http::response<http::string_body>;
using Error = beast::error_code;

constexpr std::uint32_t kHeaderBytesMax = 8192;  // a browser's is about 1 kB
constexpr std::chrono::seconds kPatience{5};     // for a request, for an answer and for one picture
constexpr std::chrono::milliseconds kPeriod{33};
constexpr unsigned short kHttpPort = 80;
constexpr const char* kOnward =
    "<!doctype html><html lang=en><meta charset=utf-8><meta http-equiv=refresh content=\"0;url=/\">"
    "<title>Telenano</title><p><a href=\"/\">Open the view</a></html>\n";
constexpr std::size_t kCookiesMax = 64;  // the oldest is forgotten
// What the kernel keeps of a slow client, twice this by its own reckoning: some seconds of pictures, which is
// how old the newest can be that it sees before the connection ends.
constexpr int kSendBufferBytes = 16384;

std::string fresh_token() {
  std::random_device device;  // the kernel's generator
  static constexpr char kHex[] = "0123456789abcdef";
  std::string text;
  for (int i = 0; i < 4; ++i) {
    const std::uint32_t word = device();
    for (unsigned shift = 0; shift < 32; shift += 4) text += kHex[(word >> shift) & 15u];
  }
  return text;
}

/// The time says nothing of how many characters are right.
bool equal(std::string_view a, std::string_view b) {
  if (a.size() != b.size()) return false;
  unsigned difference = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    difference |= static_cast<unsigned char>(a[i]) ^ static_cast<unsigned char>(b[i]);
  return difference == 0;
}

std::string_view view(beast::string_view text) {
  return {text.data(), text.size()};
}

/// Where a listener on `address` is reached: there, or at every address of this machine. Link-local ones have
/// no place in a URL.
std::vector<asio::ip::address> reached_at(const asio::ip::address& address) {
  std::vector<asio::ip::address> found;
  ifaddrs* all = nullptr;
  if (address.is_unspecified() && getifaddrs(&all) == 0) {
    for (const ifaddrs* one = all; one != nullptr; one = one->ifa_next) {
      if (one->ifa_addr == nullptr || (one->ifa_flags & IFF_UP) == 0) continue;
      if (one->ifa_addr->sa_family == AF_INET) {
        sockaddr_in v4{};
        std::memcpy(&v4, one->ifa_addr, sizeof v4);
        found.emplace_back(asio::ip::address_v4(ntohl(v4.sin_addr.s_addr)));
      } else if (one->ifa_addr->sa_family == AF_INET6 && address.is_v6()) {
        sockaddr_in6 v6{};
        std::memcpy(&v6, one->ifa_addr, sizeof v6);
        asio::ip::address_v6::bytes_type bytes{};
        std::memcpy(bytes.data(), &v6.sin6_addr, bytes.size());
        const asio::ip::address_v6 at(bytes);
        if (!at.is_link_local()) found.emplace_back(at);
      }
    }
    freeifaddrs(all);
  }
  if (found.empty()) found.push_back(address);
  return found;
}

/// "TNHG", columns, rows (u32), dx, dy, x_first, y_first (f32), then heights (f32) row by row: little-endian.
std::string bytes_of(const surface::HeightGrid& grid) {
  std::string bytes = "TNHG";
  const auto put = [&bytes](auto value) {
    std::array<char, 4> word{};
    static_assert(sizeof value == 4);
    std::memcpy(word.data(), &value, 4);  // x86-64 is little-endian
    bytes.append(word.data(), 4);
  };
  put(static_cast<std::uint32_t>(grid.columns));
  put(static_cast<std::uint32_t>(grid.rows));
  for (const double value : {grid.dx_nm, grid.dy_nm, grid.x_first_nm, grid.y_first_nm})
    put(static_cast<float>(value));
  for (const double z : grid.z_nm) put(static_cast<float>(z));
  return bytes;
}

}  // namespace

struct WebView::Impl {
  /// One browser's live connection. At most one picture is on its way; those between are left out.
  struct Live : std::enable_shared_from_this<Live> {
    Live(Impl& o, Tcp::socket s) : owner(o), socket(std::move(s)) {}
    void run(const Request& request) {
      websocket::stream_base::timeout limits{};
      limits.handshake_timeout = kPatience;
      limits.idle_timeout = std::chrono::seconds(20);  // a half-open connection ends
      limits.keep_alive_pings = true;
      socket.set_option(limits);
      socket.read_message_max(125);
      socket.control_callback([self = weak_from_this()](websocket::frame_type kind, beast::string_view) {
        if (kind == websocket::frame_type::ping)
          if (const auto live = self.lock()) live->end();
      });
      socket.async_accept(request, [self = shared_from_this()](Error error) {
        if (error) return self->end();
        self->open = true;
        self->listen();
      });
    }
    void listen() {
      socket.async_read(in, [self = shared_from_this()](Error, std::size_t) { self->end(); });
    }
    void send(const std::shared_ptr<const std::string>& text) {
      const auto now = std::chrono::steady_clock::now();
      if (!open) return;
      if (busy) {
        if (now - since > kPatience) end();
        return;
      }
      busy = true;
      since = now;
      socket.async_write(asio::buffer(*text), [self = shared_from_this(), text](Error error, std::size_t) {
        self->busy = false;
        if (error) self->end();
      });
    }
    void end() {
      open = false;
      Error ignored;
      beast::get_lowest_layer(socket).close(ignored);
      owner.live.erase(shared_from_this());
    }
    Impl& owner;
    websocket::stream<Tcp::socket, false> socket;  // without compression, which nobody is offered
    beast::flat_buffer in;
    bool open = false;
    bool busy = false;
    std::chrono::steady_clock::time_point since;
  };

  /// One request, one answer, and the connection ends or becomes live.
  struct Asking : std::enable_shared_from_this<Asking> {
    Asking(Impl& o, Tcp::socket s) : owner(o), stream(std::move(s)) {
      ++owner.asking;
      parser.header_limit(kHeaderBytesMax);
      parser.body_limit(0);
    }
    ~Asking() { --owner.asking; }
    void run() {
      stream.expires_after(kPatience);
      http::async_read(stream, in, parser, [self = shared_from_this()](Error error, std::size_t) {
        if (error) return;  // too long, too slow or no HTTP: nothing is said to it
        self->answer();
      });
    }
    void answer() {
      const Request& request = parser.get();
      if (websocket::is_upgrade(request) && request.target() == "/live") {
        Response refusal = owner.refusal(request, stream.socket(), true);
        if (refusal.result() == http::status::ok) {
          stream.expires_never();
          const auto one = std::make_shared<Live>(owner, stream.release_socket());
          owner.live.insert(one);
          one->run(request);
          return;
        }
        response = std::move(refusal);
      } else {
        response = owner.respond(request, stream.socket());
      }
      stream.expires_after(kPatience);
      http::async_write(stream, response, [self = shared_from_this()](Error, std::size_t) {
        Error ignored;
        self->stream.socket().shutdown(Tcp::socket::shutdown_both, ignored);
      });
    }
    Impl& owner;
    beast::tcp_stream stream;
    beast::flat_buffer in{kHeaderBytesMax + 1024};
    http::request_parser<http::empty_body> parser;
    Response response;
  };

  explicit Impl(WebViewConfig c) : config(std::move(c)) {
    const net::Address at = net::parse_address(config.address, "--web");
    if (!net::is_loopback(at) && !config.anybody) {
      throw UserError("--web " + config.address +
                      ": on a non-loopback address pictures and token are sent unencrypted; add --web-public "
                      "if you want that, or give 127.0.0.1:PORT");
    }
    const std::string text = net::to_string(at);
    const std::size_t colon = text.rfind(':');
    std::string host = text.substr(0, colon);
    if (host.size() > 2 && host.front() == '[') host = host.substr(1, host.size() - 2);
    Error error;
    const Tcp::endpoint local(asio::ip::make_address(host, error), at.port);
    if (!error) acceptor.open(local.protocol(), error);
    if (!error) acceptor.set_option(Tcp::acceptor::reuse_address(true), error);
    if (!error) acceptor.bind(local, error);
    if (!error) acceptor.listen(16, error);
    if (error) {
      throw UserError("--web " + config.address + ": cannot listen there: " + error.message() +
                      "; choose another port, or find out which program uses it with ss -tlpn");
    }
    std::ifstream file(config.three_js, std::ios::binary);
    three.assign(std::istreambuf_iterator<char>(file), {});
    if (three.empty())
      config.tell("--web: no picture, only numbers and charts: the package libjs-three is not installed (" +
                  config.three_js + ")");
    tell_address();
    accept();
    tick();
    const rt::SignalsBlocked blocked;
    thread = std::thread([this] {
      rt::enter_background();  // those that serve stations come first
      context.run();
    });
  }

  ~Impl() {
    context.stop();
    thread.join();
    live.clear();
  }

  void tell_address() {
    token = fresh_token();
    Error error;
    const Tcp::endpoint at = acceptor.local_endpoint(error);
    std::string urls;
    for (const asio::ip::address& address : reached_at(at.address()))
      urls += (urls.empty() ? "http://" : " or http://") + name_of({address, at.port()}) + "/?token=" + token;
    config.tell("web view, for one browser: " + urls);
  }

  /// As a browser writes it: an IPv4 client of an IPv6 socket by its own kind, and no port where that is
  /// HTTP's.
  static std::string name_of(const Tcp::endpoint& at) {
    const asio::ip::address address = plain(at.address());
    const std::string host = address.to_string();
    return (address.is_v6() ? "[" + host + "]" : host) +
           (at.port() == kHttpPort ? "" : ":" + std::to_string(at.port()));
  }

  static asio::ip::address plain(const asio::ip::address& address) {
    if (address.is_v6() && address.to_v6().is_v4_mapped())
      return asio::ip::make_address_v4(asio::ip::v4_mapped, address.to_v6());
    return address;
  }

  /// Does a request with this Host mean the address that it came to?
  static bool names(std::string_view host, const Tcp::endpoint& at) {
    std::string port = ":" + std::to_string(at.port());
    if (at.port() == kHttpPort) {
      if (host.size() > port.size() && host.substr(host.size() - port.size()) == port)
        host.remove_suffix(port.size());
      port.clear();
    }
    return host == name_of(at) || (plain(at.address()).is_loopback() && host == "localhost" + port);
  }

  void accept() {
    acceptor.async_accept([this](Error error, Tcp::socket socket) {
      if (error == asio::error::operation_aborted) return;
      // Those who connect and say nothing have a bounded number of places, for kPatience each.
      if (!error && asking < 4 * config.clients_max + 16) {
        Error ignored;
        socket.set_option(asio::socket_base::send_buffer_size(kSendBufferBytes), ignored);
        socket.set_option(Tcp::no_delay(true), ignored);  // a picture leaves when it is made
        std::make_shared<Asking>(*this, std::move(socket))->run();
      }
      if (!error) return accept();
      pause.expires_after(std::chrono::milliseconds(100));  // e.g. no file descriptor is free
      pause.async_wait([this](Error stopped) {
        if (!stopped) accept();
      });
    });
  }

  void tick() {
    timer.expires_after(kPeriod);
    timer.async_wait([this](Error error) {
      if (error) return;
      if (!live.empty()) {
        const auto text = std::make_shared<const std::string>(config.state());
        const std::vector<std::shared_ptr<Live>> all(live.begin(), live.end());
        for (const auto& one : all) one->send(text);
      }
      tick();
    });
  }

  std::string cookie_name() const { return "telenano_" + std::to_string(acceptor.local_endpoint().port()); }

  bool has_cookie(const Request& request) const {
    bool found = false;
    const std::string_view all = view(request[http::field::cookie]);
    const std::string name = cookie_name() + "=";
    for (std::size_t at = 0; at < all.size();) {
      std::size_t end = all.find(';', at);
      if (end == std::string_view::npos) end = all.size();
      std::string_view one = all.substr(at, end - at);
      while (!one.empty() && one.front() == ' ') one.remove_prefix(1);
      if (one.substr(0, name.size()) == name)
        for (const std::string& known : cookies) found = equal(one.substr(name.size()), known) || found;
      at = end + 1;
    }
    return found;
  }

  static Response plain(const Request& request, http::status status, std::string text,
                        const char* type = "text/plain; charset=utf-8") {
    Response r{status, 11};
    (void)request;
    r.set(http::field::content_type, type);
    r.set(http::field::cache_control, "no-store");
    r.set("Content-Security-Policy",
          "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
          "frame-ancestors 'none'; base-uri 'none'; form-action 'none'");
    r.set("X-Content-Type-Options", "nosniff");
    r.set("Referrer-Policy", "no-referrer");
    r.set("Cross-Origin-Resource-Policy", "same-origin");
    r.keep_alive(false);
    r.body() = std::move(text);
    r.prepare_payload();
    return r;
  }

  /// Status ok: it may be answered.
  Response refusal(const Request& request, Tcp::socket& socket, bool for_live) {
    Error error;
    const Tcp::endpoint at = socket.local_endpoint(error);
    const std::string host(view(request[http::field::host]));
    if (error || !names(host, at) || request.count(http::field::host) != 1)
      return plain(request, http::status::forbidden, "wrong Host: open the address that serve printed\n");
    const bool has_origin = request.count(http::field::origin) > 0;
    if ((has_origin || for_live) && view(request[http::field::origin]) != "http://" + host)
      return plain(request, http::status::forbidden, "wrong Origin: another page may not read this one\n");
    if (request.method() != http::verb::get)
      return plain(request, http::status::method_not_allowed, "read only\n");
    if (!for_live) return plain(request, http::status::ok, "");
    if (!has_cookie(request)) return no_right(request);
    if (live.size() >= config.clients_max)
      return plain(request, http::status::service_unavailable,
                   "no free place for another browser (--web-clients)\n");
    return plain(request, http::status::ok, "");
  }

  static Response no_right(const Request& request) {
    return plain(request, http::status::forbidden,
                 "open the newest address with a token that serve printed; each token works once\n");
  }

  Response respond(const Request& request, Tcp::socket& socket) {
    Response refused = refusal(request, socket, false);
    if (refused.result() != http::status::ok) return refused;
    const std::string_view target = view(request.target());
    constexpr std::string_view kWithToken = "/?token=";
    if (target.substr(0, kWithToken.size()) == kWithToken) {
      if (!equal(target.substr(kWithToken.size()), token)) return no_right(request);
      cookies.push_back(fresh_token());
      if (cookies.size() > kCookiesMax) cookies.pop_front();
      tell_address();
      // No redirect: a browser that came by a link of another page would not send the cookie along with it.
      Response r = plain(request, http::status::ok, kOnward, "text/html; charset=utf-8");
      r.set(http::field::set_cookie,
            cookie_name() + "=" + cookies.back() + "; Path=/; HttpOnly; SameSite=Strict");
      return r;
    }
    if (!has_cookie(request)) return no_right(request);
    if (target == "/") return plain(request, http::status::ok, kPageHtml, "text/html; charset=utf-8");
    if (target == "/view.css") return plain(request, http::status::ok, kPageCss, "text/css");
    if (target == "/view.js") return plain(request, http::status::ok, kPageJs, "text/javascript");
    if (target == "/surface")
      return plain(request, http::status::ok, bytes_of(config.heights()), "application/octet-stream");
    if (target == "/three.js" && !three.empty())
      return plain(request, http::status::ok, three, "text/javascript");
    return plain(request, http::status::not_found, "not here\n");
  }

  WebViewConfig config;
  std::string three;
  std::string token;
  std::deque<std::string> cookies;
  std::size_t asking = 0;
  asio::io_context context{1};
  Tcp::acceptor acceptor{context};
  asio::steady_timer timer{context};
  asio::steady_timer pause{context};
  std::set<std::shared_ptr<Live>> live;
  std::thread thread;
};

WebView::WebView(WebViewConfig config) : impl_(std::make_unique<Impl>(std::move(config))) {}
WebView::~WebView() = default;

}  // namespace telenano::web

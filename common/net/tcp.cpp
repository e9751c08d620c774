#include "telenano/common/net/tcp.h"

#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <utility>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ip/v6_only.hpp>

#include "telenano/common/base/error.h"
#include "telenano/common/net/socket_name.h"
#include "telenano/common/net/udp.h"

namespace telenano::net {

using boost::asio::ip::tcp;
namespace asio = boost::asio;

// As in udp.cpp: Asio makes, sets up and closes the socket; reading and writing are the plain calls.
struct TcpStream::Impl {
  asio::io_context context;
  tcp::socket socket{context};
  bool connecting = false;
  int error = 0;

  void set_up() {
    boost::system::error_code ignored;
    socket.non_blocking(true, ignored);
    socket.set_option(tcp::no_delay(true), ignored);
    socket.set_option(asio::socket_base::keep_alive(true), ignored);
  }
};

TcpStream::TcpStream() noexcept = default;
TcpStream::TcpStream(std::unique_ptr<Impl> impl) noexcept : impl_(std::move(impl)) {}
TcpStream::TcpStream(TcpStream&&) noexcept = default;
TcpStream& TcpStream::operator=(TcpStream&&) noexcept = default;
TcpStream::~TcpStream() = default;

TcpStream TcpStream::begin_connect(const Address& peer) {
  auto impl = std::make_unique<Impl>();
  const tcp::endpoint endpoint = to_endpoint<tcp::endpoint>(peer);
  boost::system::error_code error;
  impl->socket.open(endpoint.protocol(), error);
  if (error) return {};
  impl->set_up();
  if (::connect(impl->socket.native_handle(), endpoint.data(), static_cast<socklen_t>(endpoint.size())) !=
      0) {
    if (errno != EINPROGRESS) {
      impl->error = errno;
      impl->socket.close(error);
    }
    impl->connecting = impl->error == 0;
  }
  return TcpStream(std::move(impl));
}

TcpStream TcpStream::connect(const Address& peer, std::int64_t timeout_ns) {
  TcpStream stream = begin_connect(peer);
  if (stream.connecting()) {
    pollfd entry{stream.handle(), POLLOUT, 0};
    ::poll(&entry, 1, static_cast<int>(std::clamp<std::int64_t>(timeout_ns / 1'000'000, 1, 3'600'000)));
  }
  const std::string who = "cannot connect to " + to_string(peer) + " (TCP): ";
  if (stream.connecting()) throw RunError(who + "no answer");
  if (!stream.open())
    throw RunError(
        who + (stream.impl_ && stream.impl_->error != 0 ? std::strerror(stream.impl_->error) : "refused"));
  return stream;
}

bool TcpStream::open() const noexcept {
  return impl_ && impl_->socket.is_open();
}

bool TcpStream::connecting() noexcept {
  if (!open() || !impl_->connecting) return false;
  pollfd entry{handle(), POLLOUT, 0};
  if (::poll(&entry, 1, 0) == 0) return true;
  int error = 0;
  socklen_t size = sizeof error;
  ::getsockopt(handle(), SOL_SOCKET, SO_ERROR, &error, &size);
  impl_->connecting = false;
  if (error != 0) {
    impl_->error = error;
    close();
  }
  return false;
}

TcpStream::Status TcpStream::read(std::span<std::uint8_t> buffer, std::size_t& n) noexcept {
  n = 0;
  if (!open()) return Status::kClosed;
  const ssize_t got = ::recv(handle(), buffer.data(), buffer.size(), 0);
  if (got > 0) {
    n = static_cast<std::size_t>(got);
    return Status::kOk;
  }
  if (got < 0 && (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR)) return Status::kWouldBlock;
  return Status::kClosed;
}

TcpStream::Status TcpStream::write(std::span<const std::uint8_t> bytes, std::size_t& n) noexcept {
  n = 0;
  if (!open()) return Status::kClosed;
  const ssize_t sent = ::send(handle(), bytes.data(), bytes.size(), MSG_NOSIGNAL);
  if (sent >= 0) {
    n = static_cast<std::size_t>(sent);
    return Status::kOk;
  }
  if (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR) return Status::kWouldBlock;
  return Status::kClosed;
}

void TcpStream::close() noexcept {
  if (!impl_) return;
  boost::system::error_code ignored;
  impl_->socket.close(ignored);
}

void TcpStream::reset() noexcept {
  if (!open()) return;
  boost::system::error_code ignored;
  impl_->socket.set_option(asio::socket_base::linger(true, 0), ignored);
  close();
}

int TcpStream::handle() const noexcept {
  return open() ? impl_->socket.native_handle() : -1;
}

struct TcpListener::Impl {
  asio::io_context context;
  tcp::acceptor acceptor{context};
};

TcpListener::TcpListener(const Address& local) : impl_(std::make_unique<Impl>()) {
  const tcp::endpoint endpoint = to_endpoint<tcp::endpoint>(local);
  boost::system::error_code error, ignored;
  impl_->acceptor.open(endpoint.protocol(), error);
  if (!error) {
    impl_->acceptor.set_option(asio::socket_base::reuse_address(true), ignored);
    impl_->acceptor.bind(endpoint, error);
  }
  if (!error) impl_->acceptor.listen(8, error);
  if (error == asio::error::address_in_use)
    throw UserError("TCP port " + std::to_string(local.port) + " on " + to_string(local) +
                    " is in use: stop the program that holds it (ss -tlpn) or choose another port");
  if (error) throw UserError("cannot listen on " + to_string(local) + " (TCP): " + error.message());
  impl_->acceptor.non_blocking(true, ignored);
}
TcpListener::TcpListener(TcpListener&&) noexcept = default;
TcpListener& TcpListener::operator=(TcpListener&&) noexcept = default;
TcpListener::~TcpListener() = default;

TcpStream TcpListener::accept() noexcept {
  // Who looks often finds nobody almost always: then nothing is made. A context of Asio's costs nine calls of the kernel.
  pollfd entry{handle(), POLLIN, 0};
  if (::poll(&entry, 1, 0) <= 0) return {};
  try {
    auto impl = std::make_unique<TcpStream::Impl>();
    boost::system::error_code error;
    impl_->acceptor.accept(impl->socket, error);
    if (error) return {};
    impl->set_up();
    return TcpStream(std::move(impl));
  } catch (...) {
    return {};
  }
}

Address TcpListener::local() const noexcept {
  SocketName name{};
  socklen_t length = sizeof name;
  const bool told =
      ::getsockname(impl_->acceptor.native_handle(), reinterpret_cast<sockaddr*>(&name), &length) == 0;
  return told ? from_kernel(name) : Address{};
}

int TcpListener::handle() const noexcept {
  return impl_->acceptor.native_handle();
}

}  // namespace telenano::net

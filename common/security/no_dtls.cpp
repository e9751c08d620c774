// In place of dtls_*.cpp in a build without TELENANO_DTLS: the constructors tell, nothing else is ever
// called.
#include "telenano/common/base/error.h"
#include "telenano/common/security/dtls_client.h"
#include "telenano/common/security/dtls_server.h"
#include "telenano/common/security/identity_file.h"

namespace telenano::security {
namespace {

[[noreturn]] void cannot() {
  throw UserError(
      "this build cannot encrypt (TELENANO_DTLS=OFF): stay on loopback, or build with -DTELENANO_DTLS=ON");
}

const SecurityCounters kNoEvents;
const DtlsClient::Counters kNoCounters;

}  // namespace

std::string create_identity(const std::string&, const std::string&) {
  cannot();
}
std::string read_identity_name(const std::string&, const std::string&) {
  cannot();
}

struct DtlsServer::Impl {};
DtlsServer::DtlsServer(const DtlsServerConfig&, KeyList, net::Datagram&, const rt::Clock&, const rt::Clock*) {
  cannot();
}
DtlsServer::~DtlsServer() = default;
net::SendStatus DtlsServer::send(std::span<const std::uint8_t>, const net::Address&) noexcept {
  return net::SendStatus::kFailed;
}
void DtlsServer::flush() noexcept {}
bool DtlsServer::receive(std::span<std::uint8_t>, net::Received&) noexcept {
  return false;
}
void DtlsServer::offer_keys(KeyList) {}
const SecurityCounters& DtlsServer::counters() const noexcept {
  return kNoEvents;
}
std::size_t DtlsServer::established() const noexcept {
  return 0;
}
std::size_t DtlsServer::under_way() const noexcept {
  return 0;
}
const char* DtlsServer::identity(const net::Address&) const noexcept {
  return "";
}

struct DtlsClient::Impl {};
DtlsClient::DtlsClient(const DtlsClientConfig&, net::Datagram&, const net::Address&, const rt::Clock&) {
  cannot();
}
DtlsClient::~DtlsClient() = default;
net::SendStatus DtlsClient::send(std::span<const std::uint8_t>, const net::Address&) noexcept {
  return net::SendStatus::kFailed;
}
bool DtlsClient::receive(std::span<std::uint8_t>, net::Received&) noexcept {
  return false;
}
bool DtlsClient::established() const noexcept {
  return false;
}
bool DtlsClient::refused() const noexcept {
  return false;
}
std::string DtlsClient::failure() const {
  return "";
}
const DtlsClient::Counters& DtlsClient::counters() const noexcept {
  return kNoCounters;
}

}  // namespace telenano::security

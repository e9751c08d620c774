#include "telenano/common/security/dtls_resumption.h"

#include <openssl/crypto.h>
#include <openssl/evp.h>
#include <openssl/rand.h>

#include <algorithm>
#include <array>
#include <optional>
#include <string_view>

#include "telenano/common/base/error.h"
#include "telenano/common/security/dtls_context.h"

namespace telenano::security {
namespace {

// Longer than a session of the protocol can be resumed.
constexpr long kTimeoutS = 3600;

int cache_index() noexcept {
  static const int index = SSL_CTX_get_ex_new_index(0, nullptr, nullptr, nullptr, nullptr);
  return index;
}

ResumptionCache* cache_of(SSL_CTX* context) noexcept {
  return static_cast<ResumptionCache*>(SSL_CTX_get_ex_data(context, cache_index()));
}

std::optional<ResumptionCache::Id> id_of(const unsigned char* bytes, std::size_t size) noexcept {
  ResumptionCache::Id id{};
  if (size != id.size()) return {};
  std::copy_n(bytes, size, id.begin());
  return id;
}

std::optional<ResumptionCache::Id> id_of(const SSL_SESSION* session) noexcept {
  unsigned size = 0;
  const unsigned char* const bytes = SSL_SESSION_get_id(session, &size);
  return id_of(bytes, size);
}

// 0: OpenSSL keeps no reference for us.
int on_new(SSL* ssl, SSL_SESSION* session) {
  const auto id = id_of(session);
  ListName list{};
  unsigned list_size = 0;
  const unsigned char* const under = SSL_SESSION_get0_id_context(session, &list_size);
  const int size = i2d_SSL_SESSION(session, nullptr);
  std::array<unsigned char, ResumptionCache::kMaxBytes> bytes;
  if (!id || list_size != list.size() || size <= 0 || static_cast<std::size_t>(size) > bytes.size()) return 0;
  std::copy_n(under, list_size, list.begin());
  unsigned char* end = bytes.data();
  i2d_SSL_SESSION(session, &end);
  cache_of(SSL_get_SSL_CTX(ssl))->keep(*id, list, {bytes.data(), static_cast<std::size_t>(size)});
  OPENSSL_cleanse(bytes.data(), static_cast<std::size_t>(size));
  return 0;
}

SSL_SESSION* on_wanted(SSL* ssl, const unsigned char* shown, int shown_size, int* copy) {
  *copy = 0;  // it is OpenSSL's from here on
  const auto id = id_of(shown, static_cast<std::size_t>(std::max(shown_size, 0)));
  if (!id) return nullptr;
  std::array<unsigned char, ResumptionCache::kMaxBytes> bytes;
  const std::size_t size = cache_of(SSL_get_SSL_CTX(ssl))->look_up(*id, bytes);
  if (size == 0) return nullptr;
  const unsigned char* begin = bytes.data();
  SSL_SESSION* const session = d2i_SSL_SESSION(nullptr, &begin, static_cast<long>(size));
  OPENSSL_cleanse(bytes.data(), size);
  return session;
}

void on_removed(SSL_CTX* context, SSL_SESSION* session) {
  if (const auto id = id_of(session)) cache_of(context)->forget(*id);
}

}  // namespace

void resume_by(SSL_CTX* context, ResumptionCache& cache) {
  if (cache_index() < 0 || SSL_CTX_set_ex_data(context, cache_index(), &cache) != 1)
    throw RunError("DTLS cannot be set up: " + openssl_reason());
  SSL_CTX_set_session_cache_mode(context, SSL_SESS_CACHE_SERVER | SSL_SESS_CACHE_NO_INTERNAL);
  SSL_CTX_sess_set_new_cb(context, &on_new);
  SSL_CTX_sess_set_get_cb(context, &on_wanted);
  SSL_CTX_sess_set_remove_cb(context, &on_removed);
  SSL_CTX_set_timeout(context, kTimeoutS);
}

ListName name_of(const KeyList& list) noexcept {
  ListName name{};
  EVP_MD_CTX* const digest = EVP_MD_CTX_new();
  if (digest == nullptr || EVP_DigestInit_ex(digest, EVP_sha256(), nullptr) != 1) {
    EVP_MD_CTX_free(digest);
    RAND_bytes(name.data(), static_cast<int>(name.size()));  // a name of its own: nothing is resumed
    return name;
  }
  const auto add = [&](std::string_view text) {
    const std::uint64_t size = text.size();  // so that what follows cannot be taken for a part of it
    EVP_DigestUpdate(digest, &size, sizeof size);
    EVP_DigestUpdate(digest, text.data(), text.size());
  };
  for (const KeyEntry& entry : list.keys) {
    add("key");
    add(net::name(entry.rights));
    add(entry.identity);
    add({reinterpret_cast<const char*>(entry.psk.bytes.data()), entry.psk.bytes.size()});
  }
  for (const CertificateEntry& entry : list.certificates) {
    add("certificate");
    add(net::name(entry.rights));
    add(entry.name);
    add(entry.fingerprint);
  }
  for (const PublicKeyEntry& entry : list.public_keys) {
    add("public");
    add(net::name(entry.rights));
    add(entry.identity);
    add(entry.public_key);
  }
  EVP_DigestFinal_ex(digest, name.data(), nullptr);
  EVP_MD_CTX_free(digest);
  return name;
}

void resume_under(SSL_CTX* context, SSL* listener, const ListName& list) noexcept {
  constexpr auto kSize = static_cast<unsigned>(std::tuple_size_v<ListName>);
  SSL_CTX_set_session_id_context(context, list.data(), kSize);
  if (listener != nullptr) SSL_set_session_id_context(listener, list.data(), kSize);
}

}  // namespace telenano::security

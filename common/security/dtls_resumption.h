#pragma once

// Only for the files of this folder.

#include <openssl/ssl.h>

#include <array>

#include "telenano/common/security/key_list.h"
#include "telenano/common/security/resumption_cache.h"

namespace telenano::security {

/// The server's side of resuming: what its channels agree on goes into `cache`, which must outlive them, and
/// not into OpenSSL's own, which is one context's alone. Throws RunError if OpenSSL has no memory.
void resume_by(SSL_CTX* context, ResumptionCache& cache);

/// What names a list of keys: two lists that differ in who may come in, or in what each may do, have
/// different ones. Secret.
using ListName = ResumptionCache::List;
ListName name_of(const KeyList& list) noexcept;

/// What is agreed on from now on can be resumed under the same list only: of several servers, one may have a
/// new list a moment before the others, which meanwhile still let in what it no longer knows.
void resume_under(SSL_CTX* context, SSL* listener, const ListName& list) noexcept;

}  // namespace telenano::security

#pragma once

#include <string>

namespace telenano::security {

/// X.509 credentials of one end, as files in PEM form.
struct CertificateFiles {
  std::string certificate;  ///< own certificate, then those between it and the authority
  std::string key;          ///< its private key; must be private to this user
  std::string authority;    ///< certificates of the authorities that may have signed the peer's
};

}  // namespace telenano::security

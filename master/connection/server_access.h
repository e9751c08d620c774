#pragma once

#include <string>

namespace telenano::connection {

/// Where a server is, and how this station shows it who it is.
struct ServerAccess {
  std::string server = "127.0.0.1:5100";  ///< "HOST:PORT"; an IPv6 address in brackets.
  std::string key;                        ///< the station's key file; or
  std::string identity;                   ///< the station's own key pair, with
  std::string server_key;                 ///< what the servers show: "sha256:…", several with commas; or
  std::string certificate;
  std::string certificate_key;
  std::string authority;
  double connect_timeout_s = 3;  ///< how long to wait for the first answer
};

}  // namespace telenano::connection

#pragma once

#include <optional>
#include <string>

namespace telenano::app {

/// The flags of `telenano-master run`. What is left out keeps the station file's value.
struct RunOptions {
  std::string server = "127.0.0.1:5100";
  std::string key;  ///< the station's key file; or the next three
  std::string certificate;
  std::string certificate_key;
  std::string authority;
  std::string config_file;
  std::string device = "sim";
  std::string task = "indent";
  std::string script;
  std::optional<double> duration_s;
  std::optional<double> depth_nm;
  std::optional<double> rate_hz;
  std::optional<std::string> method;
  std::optional<double> velocity_scale;
  std::optional<double> force_scale;
  bool allow_unsafe_scaling = false;
  std::string record;
  bool overwrite = false;
  int realtime_priority = 80;
  double connect_timeout_s = 3;
  double give_up_s = 10;
  bool quiet = false;
  std::string command_line;
};

}  // namespace telenano::app

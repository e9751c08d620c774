#pragma once

#include <optional>
#include <string>

#include "telenano/common/link/practice_link.h"
#include "telenano/master/app/view/session_view.h"
#include "telenano/master/connection/server_access.h"

namespace telenano::app {

/// The flags of `telenano-master run`. What is left out keeps the station file's value.
struct RunOptions : connection::ServerAccess {
  std::string config_file;
  std::optional<std::string> device;
  bool home = false;
  std::string task = "indent";
  bool task_given = false;
  std::string script;
  std::optional<double> duration_s;
  std::optional<double> depth_nm;
  std::optional<double> rate_hz;
  std::optional<std::string> method;
  std::string scene;         ///< of the twin; empty: none
  std::string server_scene;  ///< of the server's several; empty: the one that it begins with
  std::optional<double> velocity_scale;
  std::optional<double> force_scale;
  std::optional<double> compand;
  bool allow_unsafe_scaling = false;
  std::optional<int> redundancy;
  std::optional<double> reply_deadband_permille;
  std::string send_hz;  ///< "auto" or a number; empty: the station file's
  std::string dscp = "ef";
  std::optional<link::PracticeLink> practice;
  std::optional<double> undo_marks_at_s;
  std::string metrics;
  bool metrics_public = false;
  std::string record;
  bool overwrite = false;
  int realtime_priority = 80;
  int realtime_cpu = -1;
  bool cpu_awake = false;
  double give_up_s = 10;
  bool observe = false;
  bool take_over = false;
  bool close_at_end = false;
  bool quiet = false;
  ViewOptions view;
  std::string command_line;
};

}  // namespace telenano::app

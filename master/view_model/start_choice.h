#pragma once

#include <string>
#include <vector>

namespace telenano::view_model {

/// What a person chooses before a session.
struct StartChoice {
  std::string server = "127.0.0.1:5100";  ///< HOST:PORT
  std::string key;                        ///< file; empty, and no identity: not encrypted
  std::string identity;                   ///< file of this station's own key pair, instead of `key`
  std::string server_key;                 ///< with it: what the server shows, "sha256:…"
  std::string server_scene;               ///< of a server with several; empty: its first
  std::string device = "sim";             ///< as --device takes it
  std::string method = "auto";
  bool guide = false;    ///< to a first touch
  double text_size = 1;  ///< of words, times the screen's own
  bool record = false;
  std::string recording = "session.h5";  ///< file, where `record`
};

/// The arguments of `telenano-master` that run this session; what is at its default is left out.
std::vector<std::string> run_arguments(const StartChoice& choice);

/// Those of the plan that says what will be felt.
std::vector<std::string> plan_arguments(const StartChoice& choice);

/// A command line that a shell reads as these words.
std::string shell_line(const std::string& program, const std::vector<std::string>& arguments);

}  // namespace telenano::view_model

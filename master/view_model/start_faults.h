#pragma once

#include <cstddef>
#include <string>

#include "telenano/master/view_model/start_choice.h"

namespace telenano::view_model {

/// What is wrong with each field of the start screen, and what to do: a line each, empty where nothing is.
struct StartFaults {
  std::string server;
  std::string key;
  std::string identity;
  std::string server_key;
  std::string server_scene;
  std::string recording;

  /// Of the first field from the top of the screen that has a fault: its line, and its name on the screen. Empty: the
  /// session can be started.
  const std::string& first() const noexcept;
  std::string first_field() const;
  /// Those of another look, for the fields that have none yet.
  void add(const StartFaults& other);
};

/// What can be seen without asking a server or looking at a file.
StartFaults start_faults(const StartChoice& choice);

/// Puts a program's line about one of its flags or files ("telenano-master: --key …", "… key file lab.key: …") to that field.
/// False: it is about none.
bool take_flag_fault(const std::string& line, const StartChoice& choice, StartFaults& faults);

/// For a person: at most so many characters, an ellipsis where that is not all, and '?' for what is no text (control
/// characters, broken UTF-8).
std::string shown_text(const std::string& text, std::size_t most);

}  // namespace telenano::view_model

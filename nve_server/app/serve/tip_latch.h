#pragma once

#include <string>
#include <vector>

namespace telenano::app {

/// That the tip of an AFM may be out, on disk: afm-HOST_PORT.out in the state folder, made before anything
/// moves, removed once the server has ended with the tip withdrawn. A server that finds one was preceded by
/// one that ended otherwise (killed, crashed, the power gone), and does not approach until an operator has
/// approved: with a file beside it, afm-HOST_PORT.approved-ID, which is used up by removing it. ID is that of
/// one latch, written anew by each server, so that an approval is for one approach of one server, and a unit
/// that restarts cannot approve itself. All files are this user's alone (0600), written beside and renamed,
/// brought to the disk before the call returns.
class TipLatch {
 public:
  /// Looks whether there is one; the folder is made if there is none. Throws UserError, one line.
  TipLatch(const std::string& folder, const std::string& controller);

  /// Somebody has left one, and nobody has approved yet.
  bool held() const noexcept { return held_; }
  /// True once after an approval, which is then gone.
  bool take_approval();
  /// Before anything moves. Throws UserError.
  void set();
  /// The tip is known to be up. Nothing if it was not set.
  void clear();

 private:
  std::string path_;
  std::string id_;
  bool held_ = false;
  bool set_ = false;
};

/// --afm-state, or $STATE_DIRECTORY (systemd), or $XDG_STATE_HOME/telenano, or ~/.local/state/telenano.
std::string state_folder(const std::string& flag);

/// Approves the one latch in the folder, or the one of `controller` (HOST:PORT); says which. Throws UserError
/// where there is none, or several and no controller is named.
std::string approve_tip(const std::string& folder, const std::string& controller);

}  // namespace telenano::app

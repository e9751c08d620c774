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
///
/// The same controller may be reached by another port than last time (a deadman has come between). So a
/// latch of another port on the same host counts too, unless a server that runs has it: each holds a lock
/// (flock) on its own.
class TipLatch {
 public:
  /// Looks whether there is one; the folder is made if there is none. Throws UserError, one line.
  TipLatch(const std::string& folder, const std::string& controller);
  ~TipLatch();
  TipLatch(const TipLatch&) = delete;
  TipLatch& operator=(const TipLatch&) = delete;

  /// Somebody has left one, and nobody has approved yet.
  bool held() const noexcept { return !left_.empty(); }
  /// True once after an approval, which is then gone.
  bool take_approval();
  /// Before anything moves; what others have left is this one's from then on. Throws UserError.
  void set();
  /// The tip is known to be up. Nothing if it was not set.
  void clear();

 private:
  struct Left {
    std::string path, id;
  };
  std::string path_;
  std::vector<Left> left_;           ///< not approved yet
  std::vector<std::string> others_;  ///< of other ports, to be replaced by this one's
  bool set_ = false;
  int lock_ = -1;
};

/// --afm-state, or $STATE_DIRECTORY (systemd), or $XDG_STATE_HOME/telenano, or ~/.local/state/telenano.
std::string state_folder(const std::string& flag);

/// Approves the one latch in the folder, or the one of `controller` (HOST:PORT); says which. Throws UserError
/// where there is none, or several and no controller is named.
std::string approve_tip(const std::string& folder, const std::string& controller);

}  // namespace telenano::app

#pragma once

#include <string>

namespace telenano::view_model {

/// What is known of the server's scene beside its surface; it may come while the session runs.
struct ServerScene {
  double tip_radius_nm = 0;  ///< 0: not known
  std::string words;         ///< one line, to be said once; empty: nothing
  std::string note;          ///< the same in short, for as long as it is so
};

struct DrawnTip {
  double radius_nm = 0;
  std::string words;
  std::string doubt;  ///< why it may be another one; empty: it is the scene's
};
/// `given_nm`: by a person, `known_nm`: of the scene; 0: not.
DrawnTip drawn_tip(double given_nm, double known_nm);

}  // namespace telenano::view_model

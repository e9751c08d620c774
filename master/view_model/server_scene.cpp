#include "telenano/master/view_model/server_scene.h"

#include <fmt/format.h>

namespace telenano::view_model {

DrawnTip drawn_tip(double given_nm, double known_nm) {
  constexpr double kAssumed_nm = 20;
  const bool given = given_nm > 0;
  const bool known = known_nm > 0;
  const double radius_nm = given ? given_nm : known ? known_nm : kAssumed_nm;
  DrawnTip tip{radius_nm, fmt::format("tip radius drawn: {:g} nm", radius_nm), ""};
  if (!given && !known) tip.doubt = "(assumed)";
  if (given && !known) tip.doubt = "(as given)";
  if (given && known && given_nm != known_nm) tip.doubt = fmt::format("(the scene's: {:g} nm)", known_nm);
  return tip;
}

}  // namespace telenano::view_model

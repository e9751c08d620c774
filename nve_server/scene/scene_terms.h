#pragma once

#include <memory>
#include <string>
#include <vector>

#include "telenano/nve_server/scene/scene.h"

namespace telenano::scene {

/// A scene without one of its terms, to see what that term costs and does. For measuring: it keeps the
/// scene's name, hash, limits and workspace, and is no scene to serve.
struct WithoutTerm {
  std::string term;  ///< as SceneSummary::terms_in names it
  std::shared_ptr<const Scene> scene;
};

/// One for each term that can be left out of this scene. Retardation and cone are van der Waals forces and go
/// with it; the contact itself stays.
std::vector<WithoutTerm> without_each_term(const Scene& scene);

}  // namespace telenano::scene

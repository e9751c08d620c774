#pragma once

#include <string>

#include "telenano/master/viewer/gui.h"
#include "telenano/master/viewer/scene_renderer.h"

namespace telenano::viewer {

/// A title and a sentence at the top of a picture, under that picture's own title. Before the words of the
/// picture, which give way to it; left out where there is no room. `part`: how much is done, 0 to 1.
void draw_guide_box(const Gui& gui, const std::string& title, const std::string& words, double part,
                    const Area& area);

}  // namespace telenano::viewer

#pragma once

#include "telenano/master/view_model/colour_map.h"

/// The colours of the program, one meaning each wherever they appear.
namespace telenano::viewer::palette {

using view_model::Rgb;

inline constexpr Rgb kBackground{0.071f, 0.082f, 0.102f};
inline constexpr Rgb kPanel{0.098f, 0.114f, 0.141f};
inline constexpr Rgb kRaised{0.153f, 0.176f, 0.216f};
inline constexpr Rgb kEdge{0.220f, 0.251f, 0.302f};
inline constexpr Rgb kText{0.878f, 0.902f, 0.933f};
inline constexpr Rgb kQuiet{0.553f, 0.604f, 0.667f};

inline constexpr Rgb kRepulsion{0.976f, 0.604f, 0.290f};   ///< force away from the sample, contact
inline constexpr Rgb kAttraction{0.353f, 0.694f, 0.980f};  ///< force towards the sample
inline constexpr Rgb kTarget{0.812f, 0.588f, 0.965f};      ///< where the hand wants the tip
inline constexpr Rgb kFree{0.620f, 0.780f, 0.720f};        ///< trail away from the sample
inline constexpr Rgb kTip{0.800f, 0.820f, 0.850f};
inline constexpr Rgb kLever{0.560f, 0.600f, 0.660f};
inline constexpr Rgb kParticle{0.930f, 0.800f, 0.560f};
inline constexpr Rgb kParticleCut{0.680f, 0.560f, 0.360f};

inline constexpr Rgb kGood{0.353f, 0.780f, 0.502f};
inline constexpr Rgb kWarning{0.949f, 0.757f, 0.298f};
inline constexpr Rgb kAlarm{0.914f, 0.294f, 0.294f};

}  // namespace telenano::viewer::palette

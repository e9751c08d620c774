#pragma once

namespace telenano {

inline constexpr double kPi = 3.14159265358979323846;

/// Between the nano side (nm, nN, aJ) and SI. Only control/scaling and the wire's borders may use these.
inline constexpr double kNmPerM = 1e9;
inline constexpr double kNanonewtonPerNewton = 1e9;
inline constexpr double kAttojoulePerJoule = 1e18;

}  // namespace telenano

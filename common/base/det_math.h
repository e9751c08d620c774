#pragma once

#include <cstddef>

namespace telenano {

/// Elementary functions that give the same bits on every x86-64: glibc picks code with or without fused
/// multiply-add by the machine it runs on, and the two differ in the last bit. Built from +, -, *, / and sqrt
/// only, within 1 ulp or so. (sqrt, floor, fabs and copysign of the standard library are exact and may be
/// used as they are.)

struct SinCos {
  double sin;
  double cos;
};

SinCos det_sin_cos(double x) noexcept;  ///< |x| <= 1e6; non-finite gives NaN
double det_exp(double x) noexcept;
/// Of each of several, with the bits of det_exp(): two at once. May be the same array.
void det_exp_each(const double* x, std::size_t count, double* exp) noexcept;
double det_log(double x) noexcept;
double det_cbrt(double x) noexcept;
double det_acos(double x) noexcept;  ///< [-1, 1]
double det_atan(double x) noexcept;

}  // namespace telenano

#pragma once

#include <cstddef>

#include "telenano/nve_server/physics/surface/cubic_weights.h"

namespace telenano::physics {

/// A level of softening in the blend of a place: H, ρ, c in three lanes of the 4 × 4 coefficients around it.
struct StencilLevel {
  const double* corner =
      nullptr;                ///< first of the 4 × 4; nodes follow each other by `lanes`, rows by `stride`
  std::ptrdiff_t stride = 0;  ///< in doubles
  int lanes = 0;              ///< 4 at least
  int first_lane = 0;         ///< of H: 0, or 3 of 6
  const CubicWeights* along_x = nullptr;
  const CubicWeights* along_y = nullptr;
  double weight = 1;        ///< in the blend
  double slope_per_nm = 0;  ///< of the weight, over v0 (softening.h)
  double bend_per_nm2 = 0;
};

/// Value, ∂x, ∂y, ∂xx, ∂xy, ∂yy of one field.
enum { kValue, kX, kY, kXx, kXy, kYy };

/// A field of the apex with its gradient and Hessian: rows of FieldRows.
enum { kAt, kGx, kGy, kGz, kHxx, kHxy, kHxz, kHyy, kHyz, kHzz, kFieldRows };
/// Columns H, ρ, c; the fourth means nothing.
using FieldRows = double[kFieldRows][4];

/// The arithmetic of scan_fields.h on vectors of four: of two SSE2 registers, which each x86-64 has, or of
/// one AVX register where the processor has it. Both do the same operations in the same order, without fused
/// multiply-add: the same bits.
struct StencilKernel {
  /// The jet of one lane.
  void (*one)(const double* corner, std::ptrdiff_t stride, int lanes, const CubicWeights& along_x,
              const CubicWeights& along_y, double (&jet)[6]) noexcept;
  /// H, ρ, c of one level, whatever its weight.
  void (*plain)(const StencilLevel& level, FieldRows& rows) noexcept;
  /// H, ρ, c of the levels by their weights, which are functions of v0 = z − H_0: `finest` is the jet of H_0.
  void (*blend)(const StencilLevel* levels, int count, const double (&finest)[6], FieldRows& rows) noexcept;
};

/// Of SSE2 registers.
const StencilKernel& narrow_kernel() noexcept;
/// Of AVX registers; null where the processor has none.
const StencilKernel* wide_kernel() noexcept;
/// The faster one that there is.
const StencilKernel& stencil_kernel() noexcept;

}  // namespace telenano::physics

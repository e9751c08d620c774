#pragma once

// The stencils of field_stencil.h for a vector V of four doubles. Included by one file for each V, which is
// compiled for what V needs: all in here is the file's own, so that no code for one processor is linked where
// the other's is called.

#include <cstddef>

#include "telenano/nve_server/physics/surface/field_stencil.h"

namespace telenano::physics {
namespace {

// Along y first: rows of the stencil into value, slope and bend of each of the four columns, which the
// weights along x then make the six derivatives of.
template <class V>
struct Columns {
  V value[4], slope[4], bend[4];
};

template <class V, class Load>
inline Columns<V> along_y(const Load& load, const CubicWeights& w, int count) noexcept {
  Columns<V> out;
  const auto pass = [&](const double(&weight)[4], V(&to)[4]) {
    const V w0 = V::all(weight[0]), w1 = V::all(weight[1]), w2 = V::all(weight[2]), w3 = V::all(weight[3]);
    for (int i = 0; i < count; ++i) {
      to[i] = (load(i, 0) * w0 + load(i, 1) * w1) + (load(i, 2) * w2 + load(i, 3) * w3);
    }
  };
  pass(w.value, out.value);
  pass(w.slope, out.slope);
  pass(w.bend, out.bend);
  return out;
}

template <class V>
inline V along_x(const V (&column)[4], const double (&weight)[4]) noexcept {
  return ((column[0] * V::all(weight[0]) + column[1] * V::all(weight[1])) + column[2] * V::all(weight[2])) +
         column[3] * V::all(weight[3]);
}

template <class V>
inline void level_jet(const StencilLevel& level, V (&jet)[6]) noexcept {
  // Of the odd level of two the lanes 2 to 5 are read, never those of the next node, and turned into order.
  const bool odd = level.first_lane != 0;
  const double* const corner = level.corner + (odd ? level.first_lane - 1 : 0);
  const auto load = [&](int i, int row) { return V::load(corner + row * level.stride + i * level.lanes); };
  const Columns<V> columns = along_y<V>(load, *level.along_y, 4);
  const CubicWeights& x = *level.along_x;
  jet[kValue] = along_x(columns.value, x.value);
  jet[kX] = along_x(columns.value, x.slope);
  jet[kY] = along_x(columns.slope, x.value);
  jet[kXx] = along_x(columns.value, x.bend);
  jet[kXy] = along_x(columns.slope, x.slope);
  jet[kYy] = along_x(columns.bend, x.value);
  if (odd) {
    for (int d = 0; d < 6; ++d) jet[d] = jet[d].turned();
  }
}

template <class V>
void one(const double* corner, std::ptrdiff_t stride, int lanes, const CubicWeights& x, const CubicWeights& y,
         double (&jet)[6]) noexcept {
  const auto load = [&](int, int row) { return V::gather(corner + row * stride, lanes); };
  const Columns<V> columns = along_y<V>(load, y, 1);
  // The four columns are the lanes.
  const auto sum = [](const V& column, const double(&weight)[4]) {
    double part[4];
    (column * V::load(weight)).store(part);
    return ((part[0] + part[1]) + part[2]) + part[3];
  };
  jet[kValue] = sum(columns.value[0], x.value);
  jet[kX] = sum(columns.value[0], x.slope);
  jet[kY] = sum(columns.slope[0], x.value);
  jet[kXx] = sum(columns.value[0], x.bend);
  jet[kXy] = sum(columns.slope[0], x.slope);
  jet[kYy] = sum(columns.bend[0], x.value);
}

template <class V>
void plain(const StencilLevel& level, FieldRows& rows) noexcept {
  V jet[6];
  level_jet(level, jet);
  const V zero = V::all(0.0);
  jet[kValue].store(rows[kAt]);
  jet[kX].store(rows[kGx]);
  jet[kY].store(rows[kGy]);
  zero.store(rows[kGz]);
  jet[kXx].store(rows[kHxx]);
  jet[kXy].store(rows[kHxy]);
  zero.store(rows[kHxz]);
  jet[kYy].store(rows[kHyy]);
  zero.store(rows[kHyz]);
  zero.store(rows[kHzz]);
}

// F(x, y, u(x, y, z)) with u = z − H_0: ∇u = (−H_0x, −H_0y, 1), ∇∇u = −∇∇H_0.
template <class V>
void blend(const StencilLevel* levels, int count, const double (&finest)[6], FieldRows& rows) noexcept {
  V f[6], u[3], uu = V::all(0.0);  // u: ∂/∂u of value, x and y
  for (V& one : f) one = uu;
  for (V& one : u) one = uu;
  for (int k = 0; k < count; ++k) {
    V jet[6];
    level_jet(levels[k], jet);
    const V w = V::all(levels[k].weight), w1 = V::all(levels[k].slope_per_nm),
            w2 = V::all(levels[k].bend_per_nm2);
    for (int d = 0; d < 6; ++d) f[d] = f[d] + w * jet[d];
    for (int d = 0; d < 3; ++d) u[d] = u[d] + w1 * jet[d];
    uu = uu + w2 * jet[kValue];
  }
  const V a = V::all(-finest[kX]), b = V::all(-finest[kY]), two = V::all(2.0);
  f[kValue].store(rows[kAt]);
  (f[kX] + u[0] * a).store(rows[kGx]);
  (f[kY] + u[0] * b).store(rows[kGy]);
  u[0].store(rows[kGz]);
  (((f[kXx] + two * u[1] * a) + uu * a * a) - u[0] * V::all(finest[kXx])).store(rows[kHxx]);
  (((f[kXy] + u[1] * b) + u[2] * a) + uu * a * b - u[0] * V::all(finest[kXy])).store(rows[kHxy]);
  (u[1] + uu * a).store(rows[kHxz]);
  (((f[kYy] + two * u[2] * b) + uu * b * b) - u[0] * V::all(finest[kYy])).store(rows[kHyy]);
  (u[2] + uu * b).store(rows[kHyz]);
  uu.store(rows[kHzz]);
}

}  // namespace
}  // namespace telenano::physics

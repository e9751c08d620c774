#pragma once

#include <algorithm>
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "telenano/common/surface/reserved_memory.h"
#include "telenano/nve_server/physics/surface/bicubic_spline.h"
#include "telenano/nve_server/physics/surface/contact_fields.h"
#include "telenano/nve_server/physics/surface/dilation.h"
#include "telenano/nve_server/physics/surface/field_stencil.h"
#include "telenano/nve_server/physics/surface/height_grid.h"
#include "telenano/nve_server/physics/surface/softening.h"
#include "telenano/nve_server/physics/surface/softening_table.h"
#include "telenano/nve_server/physics/surface/stroke_history.h"

namespace telenano::physics {

/// An impression in the fields of the apex.
struct FieldMark {
  double x_nm = 0;  ///< of the apex
  double y_nm = 0;
  double depth_nm = 0;         ///< by which H falls there, at all softenings
  double radius_nm = 0;        ///< of the crater's rim
  double log_radius_rise = 0;  ///< by which ρ rises there, at all softenings
  /// ε of the material (flow_family.h): around the mark ρ rises by what belongs to the depth to which H
  /// falls.
  double strain = 0;
  double last_radius_nm = 1e9;  ///< at which the radius stops rising
  /// What stands in the rim afterwards, of the volume that the crater has lost.
  double pile_up = 0;
};

/// The ground of a scan as fields of the apex: levels of softening t0 2^k (dilation.h), blended over the
/// level that softening.h gives to the distance from touch.
///
/// Formula   v = H − z, δ = v c, with F(x, y, z) = Σ_k w_k(level(v0)) F_k(x, y) for F = H, ρ, c and v0 = z −
///           H_0(x, y). Planes are exact as each level is. On a curved foot at an angle θ the normal overlap
///           is more by v² sin²θ/(2(R + 1/κ)): 0.2 % of v at v = 0.3 nm, 30°, R = 20 nm on a ball of that
///           radius.
/// Grids     Two levels share one grid; the first two grids are equally fine, each next one is twice as wide.
///           Fields are bicubic B-splines by the quasi-interpolant c = (1 − Δ/6)f along x and y, which a
///           node's neighbours fix (error O(h⁴)). That of c is kept between the least and the greatest of the
///           3 × 3 nodes, for it may not overshoot beside a cliff. Energy does not depend on the grid:
///           derivatives are those of these splines. Creases over grooves, t0 over the difference of their
///           slopes wide, are rounded off: H by 0.03 nm and two feet to 1.8 of one radius on a groove of ±15°
///           at nodes 1 nm apart, 0.004 nm and 1.94 at 0.27 nm.
/// Growth    A larger t may lower H where much lies just below the top, and pressing deeper would then lift
///           the ground away. The coarser levels are held high enough (hold_growth) that −∂δ/∂z stays above
///           kLeastRate and a Hertzian contact stable, seen at 14 400 places of each of two real scans.
/// Blend     Value and gradient go on without a step; second derivatives step where three levels become the
///           next three (quadratic B-splines over the level).
/// Outside   the scan its mirror image goes on.
/// Tiles     Of a large scan the coefficients are made tile by tile, where somebody looks: the same bits as if
///           all had been made at once, in whatever order. Who looks where nothing is made yet makes it, or
///           waits for another thread that is at it (some 10 ms): the one case in which a step allocates and
///           waits. A thread of its own, make_wished(), is ahead of those who move on.
/// Pull-off  With a kernel ρ of the finest level is the radius whose pull-off is that of all that the tip feels
///           there (retraction_kernel.h): several feet, or one that is no paraboloid.
/// Radius    ρ is at most ln(kMostRadii R): a pit that fits the tip better is felt as that.
/// Marks     press() changes coefficients, which belong to the session: a copy shares what was made, and has
///           tiles of kTile × kTile coefficients of its own where it has been pressed. Memory for them is
///           reserved in whole when a copy is made for marks, and taken page by page as tiles are written (at
///           once where the process locks its memory), so that a step never allocates.
class ScanFields final : public ContactFields {
 public:
  /// Needs at least 2×2 finite samples, positive spacing, radius and softenings; UserError. For each of the
  /// `fixed_softenings_nm` at_softening() has a layer made at just that length: exact, and one stencil.
  /// `made`, if given, hears now and then which part of the work is done, from 0 to 1. `pull_off`: see above;
  /// null: ρ is that of the feet's curvatures.
  ScanFields(const HeightGrid& grid, double tip_radius_nm, const SofteningRule& rule,
             const std::vector<double>& fixed_softenings_nm = {},
             const std::function<void(double)>& made = {},
             std::shared_ptr<const RetractionKernel> pull_off = {});

  /// The same of a grid whose spline is made already, by tiles.
  static ScanFields by_tiles(const HeightGrid& grid, std::shared_ptr<const BicubicSpline> height,
                             double tip_radius_nm, const SofteningRule& rule,
                             const std::vector<double>& fixed_softenings_nm = {},
                             std::shared_ptr<const RetractionKernel> pull_off = {});
  /// Would all at once take a minute and gigabytes?
  static bool is_large(const HeightGrid& grid, double tip_radius_nm, const SofteningRule& rule) noexcept;
  bool tiled() const noexcept { return tiles_ != nullptr; }
  /// Makes what somebody who looked nearby will look at next, of one place; false: nothing is wished for. By
  /// one thread only, which learns where they go.
  bool make_wished() const;
  /// While it is so nobody wishes: for who looks here and there and does not come back.
  void wish_nothing(bool nothing) const noexcept;
  /// Makes all that is looked at within `reach_nm` of a place, in either direction.
  void make_around(double x_nm, double y_nm, double reach_nm) const;

  /// What the constructor makes of the same arguments may be kept, and brought back: coefficients() of each
  /// grid and layer, valid for the version that made them. None where these coefficients cannot be such:
  /// their number, a value that is no number, a height, radius or cosine that no ground of this relief has.
  /// Whether they are of this ground only who kept them can know.
  static constexpr std::uint32_t kVersion = 6;
  std::vector<std::span<const double>> coefficients() const;  ///< by tiles: makes them all
  static std::optional<ScanFields> restored(const HeightGrid& grid, double tip_radius_nm,
                                            const SofteningRule& rule,
                                            const std::vector<double>& fixed_softenings_nm,
                                            std::vector<std::vector<double>> coefficients);

  /// For marks: the same ground, to be pressed by one session. `unmarked` may end before it.
  static ScanFields for_marks(const ScanFields& unmarked);

  /// Afterwards, at the apex (x, y) of the mark and all softenings: H is less by the depth, ρ is more by the
  /// rise, slopes of H are what they were (to rounding); δ at (x, y, z) is what it was at (x, y, z + depth).
  /// Nothing has changed further than twice the rim, or some nodes, from it. A mark that is no number, or has
  /// a negative depth, radius or pile-up, changes nothing, nor does one on fields that are not for_marks().
  /// No allocation. Takes O(radius²/node²).
  void press(const FieldMark& mark) noexcept;
  /// From now on keeps there what each tile was before a stroke changed it; null: nobody. Grids are numbered as
  /// Pressed::grid.
  void keep_strokes_in(StrokeHistory* history) noexcept { strokes_ = history; }
  std::vector<std::size_t> tiles_of_grids() const;
  std::size_t grid_count() const noexcept { return grids_.size() + layers_.size(); }
  /// The tile has these values, and they those that it had. Does not allocate.
  void exchange_tile(std::size_t grid, std::size_t tile, double* values) noexcept;
  /// Cosine of the feet at an apex, and ρ there as it was before any mark, both at the softening that
  /// contact_at() has there.
  void ground_at(const Vec3& apex_w_nm, double& cosine, double& unmarked_log_radius) const noexcept;
  /// Coefficients of this session's own, in bytes: what has been pressed.
  std::size_t own_bytes() const noexcept;
  /// No ρ of these fields is above this: splines stay within their coefficients. Without marks. By tiles: the
  /// most that there can be.
  double largest_log_radius() const noexcept;

  /// Of what marks have changed, by place and bits, whatever the order and whatever was there between; 0: all
  /// as it was made. Kept as marks are pressed.
  std::uint64_t marks_digest() const noexcept;
  /// What a mark may change of a coefficient: H and ρ, of both levels; 0 where there is one level.
  struct Pressed {
    std::uint32_t grid = 0;    ///< fields, then layers
    std::uint32_t number = 0;  ///< of the coefficient in it
    double value[4] = {0, 0, 0, 0};
  };
  /// Tells of each coefficient that marks have changed, grid by grid in rising order.
  template <class Found>
  void each_pressed(const Found& found) const;
  /// All coefficients that marks could change.
  std::size_t pressable() const noexcept;
  /// As each_pressed() told of another session on this ground. False, and nothing has changed, where there is
  /// no such coefficient or no such value: not finite, or too far from what was made for any mark. Does not
  /// allocate.
  bool set_pressed(const Pressed& pressed) noexcept;
  /// As it was made. Does not allocate.
  void unmark() noexcept;

  void contact_at(const Vec3& apex_w_nm, ContactJet& jet) const noexcept override;
  void growing_at(const Vec3& apex_w_nm, const SofteningRule& rule, ContactJet& jet) const noexcept override;
  void at_softening(const Vec3& apex_w_nm, double softening_nm, ContactJet& jet) const noexcept override;
  void values_at_softening(const Vec3& apex_w_nm, double softening_nm, double& overlap_nm,
                           double& log_radius) const noexcept override;

  /// Apex height of first touch, at the finest softening.
  double touch_height_nm(double x_nm, double y_nm) const noexcept;
  const SofteningRule& rule() const noexcept { return rule_; }
  int levels() const noexcept { return levels_; }
  double tip_radius_nm() const noexcept { return radius_; }
  std::size_t bytes() const noexcept;
  /// FNV-1a over the coefficients of all levels: the same on every machine.
  std::uint64_t hash() const;

  static constexpr double kLeastRate = 0.3;
  static constexpr double kMostRadii = 16;

 private:
  static constexpr int kLanes = 6;  // H, ρ, c of the even level, then of the odd one
  static constexpr int kTile = 16;  // coefficients along a side
  struct Release {
    void operator()(void* p) const noexcept { std::free(p); }
  };
  class Tiles;
  struct Grid {
    int lanes = kLanes;
    int columns = 0, rows = 0;  // of nodes
    double inv_dx = 1, inv_dy = 1;
    // (columns + 2)(rows + 2) lanes, one node more at either side; shared by all copies.
    std::shared_ptr<double> made;
    // By tiles: who knows what is made, and makes it; null: all is.
    Tiles* tiles = nullptr;
    int grid_number = 0;  // fields, then layers
    // The same layout, where a session has pressed. A tile is `copied` when its coefficients are in `own`,
    // and `usable` when those of the next ones are, too, which the stencils that begin in it reach.
    std::unique_ptr<double[], Release> own_whole;
    std::unique_ptr<surface::ReservedMemory> own_tiles;
    double* own = nullptr;
    // What the digest counts of each coefficient in `own`, kept: a mark changes a coefficient again and again, and its
    // word takes longer than the change. Right wherever a tile is `copied`.
    std::unique_ptr<std::uint64_t[], Release> words_whole;
    std::unique_ptr<surface::ReservedMemory> words_tiles;
    std::uint64_t* words = nullptr;
    std::vector<std::uint8_t> copied, usable;
    int tiles_across = 0;
    std::uint64_t digest = 0;  // Σ of (words of place and new bits) less (of place and old bits)

    int stride() const noexcept { return (columns + 2) * lanes; }
    std::size_t size() const noexcept {
      return static_cast<std::size_t>(columns + 2) * static_cast<std::size_t>(rows + 2) *
             static_cast<std::size_t>(lanes);
    }
    /// Where the 4 × 4 coefficients of a cell begin.
    const double* corner(int column, int row) const noexcept {
      const std::size_t at = static_cast<std::size_t>(row) * static_cast<std::size_t>(stride()) +
                             static_cast<std::size_t>(column) * static_cast<std::size_t>(lanes);
      const bool pressed =
          own && usable[static_cast<std::size_t>((row / kTile) * tiles_across + column / kTile)];
      if (pressed) return own + at;
      if (tiles != nullptr) see(column, row);
      return made.get() + at;
    }
    /// By tiles: the 4 × 4 coefficients of a cell are made afterwards.
    void see(int column, int row) const noexcept;
    /// By tiles: these padded coefficients are.
    void need(int left, int right, int low, int high) const noexcept;
    void copy_tile(int across, int along) noexcept;
    void make_usable(int first_column, int last_column, int first_row, int last_row) noexcept;
    /// Each line of a tile: use(where it begins, how many values).
    template <class Use>
    void each_line(std::size_t tile, const Use& use) const noexcept;
    void keep_tiles(StrokeHistory& history, std::size_t grid, int first_column, int last_column,
                    int first_row, int last_row) const noexcept;
    /// Of a coefficient, by place and bits, of what marks may change: found anew.
    std::uint64_t word(std::size_t number) const noexcept;
    class Changing;
    template <class Found>
    void each_pressed(std::uint32_t grid, const Found& found) const;
    void unmark() noexcept;
    Grid for_marks() const;
  };
  struct Layer {
    double softening_nm = 0;
    Grid grid;  // kLayerLanes lanes
  };
  static constexpr int kLayerLanes = 4;  // H, ρ, c, 0
  static constexpr std::size_t kMostTogether = 8;
  void press_alike(const Grid& one, const FieldMark& mark, double x, double y) noexcept;
  class Pressing;
  void press(std::span<Grid* const> grids, const FieldMark& mark, double x, double y) noexcept;
  void hold_up(std::size_t coarse, double x, double y) noexcept;
  const Layer* layer_of(double softening_nm) const noexcept;
  ScanFields() = default;
  /// All but the coefficients; the lattice of the coarsest grid.
  DilationLattice lay_out(const HeightGrid& grid, const BicubicSpline& height,
                          const std::vector<double>& fixed_softenings_nm);
  DilationLattice lattice_of(const Grid& grid, DilationLattice top, double softening_nm) const noexcept;
  double softening_of_level(int level) const noexcept {
    return rule_.finest_nm * (1 << std::min(level, levels_ - 1));
  }
  /// Where x is in the mirrored scan, in [0, extent], and whether it runs backwards there.
  std::size_t bytes_of_tiles() const noexcept;
  static double mirrored(double offset, double extent, bool& backwards) noexcept;
  /// Padded coefficients of a grid from left to right and low to high, somewhere in memory.
  struct Patch {
    int left, right, low, high;
    double* first;
    std::ptrdiff_t stride;
    int lanes;
    double* at(int i, int j) const noexcept { return first + (j - low) * stride + (i - left) * lanes; }
  };
  static Patch whole(const Grid& grid) noexcept {
    return {0, grid.columns + 1, 0, grid.rows + 1, grid.made.get(), grid.stride(), grid.lanes};
  }
  /// H, ρ, c of nodes, from (i0, j0) on and nx a row, into three lanes of coefficients from `lane` on.
  static void interpolate(const Grid& grid, const std::vector<DilatedNode>& nodes, int i0, int j0, int nx,
                          double most_log_radius, const Patch& to, int lane) noexcept;
  static int folded(int i, int count) noexcept { return i < 0 ? -i : (i < count ? i : 2 * count - 2 - i); }
  class Rises;
  static void hold_growth(const Patch& fields, double fine_t) noexcept;
  static void hold_growth(const Grid& finer, const Patch& fine, const Grid& coarse, const Patch& raw,
                          const Patch& raised, double fine_t);
  struct Place;
  Place place(double x_nm, double y_nm) const noexcept;
  struct Cell;
  void blended(const Place& place, const Cell& finest_cell, const double (&finest)[6], double z_nm,
               const SofteningLevel& level, ContactJet& jet) const noexcept;

  std::size_t number_of_grid(const Grid& grid) const noexcept;
  Grid* grid_of(std::uint32_t number) noexcept {
    if (number < grids_.size()) return &grids_[number];
    return number - grids_.size() < layers_.size() ? &layers_[number - grids_.size()].grid : nullptr;
  }

  const StencilKernel* kernel_ = &stencil_kernel();
  SofteningRule rule_;
  SofteningTable softening_;
  double radius_ = 0;
  int levels_ = 0;
  double x_first_ = 0, y_first_ = 0, width_ = 0, length_ = 0;
  std::vector<Grid> grids_;
  std::vector<Layer> layers_;
  std::shared_ptr<Tiles> tiles_;  // of a large scan
  StrokeHistory* strokes_ = nullptr;
};

template <class Found>
void ScanFields::Grid::each_pressed(std::uint32_t grid, const Found& found) const {
  if (!own) return;
  const int levels = lanes == kLanes ? 2 : 1;
  const int tiles_along = static_cast<int>(copied.size()) / tiles_across;
  for (int tj = 0; tj < tiles_along; ++tj) {
    for (int j = tj * kTile; j < std::min((tj + 1) * kTile, rows + 2); ++j) {
      for (int ti = 0; ti < tiles_across; ++ti) {
        if (copied[static_cast<std::size_t>(tj * tiles_across + ti)] == 0) continue;
        for (int i = ti * kTile; i < std::min((ti + 1) * kTile, columns + 2); ++i) {
          const int number = j * (columns + 2) + i;
          const std::size_t at = static_cast<std::size_t>(number) * static_cast<std::size_t>(lanes);
          Pressed pressed{grid, static_cast<std::uint32_t>(number), {}};
          bool changed = false;
          for (int level = 0; level < levels; ++level) {
            for (int lane = 0; lane < 2; ++lane) {
              const std::size_t k = at + static_cast<std::size_t>(3 * level + lane);
              pressed.value[2 * level + lane] = own[k];
              changed |= std::bit_cast<std::uint64_t>(own[k]) != std::bit_cast<std::uint64_t>(made.get()[k]);
            }
          }
          if (changed) found(pressed);
        }
      }
    }
  }
}

template <class Found>
void ScanFields::each_pressed(const Found& found) const {
  std::uint32_t number = 0;
  for (const Grid& grid : grids_) grid.each_pressed(number++, found);
  for (const Layer& layer : layers_) layer.grid.each_pressed(number++, found);
}

}  // namespace telenano::physics

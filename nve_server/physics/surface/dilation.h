#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <vector>

#include "telenano/nve_server/physics/surface/bicubic_spline.h"
#include "telenano/nve_server/physics/surface/part_extremes.h"
#include "telenano/nve_server/physics/surface/retraction_kernel.h"

namespace telenano::physics {

/// The scan dilated by the tip, softened over a length t: what a sphere of radius R feels of the ground below
/// its apex, as three numbers at each node of a grid.
///
/// Model     Each element of the tip attracts the ground below it like e^{−gap/t}. With h the ground and ψ(r)
///           = √(R² − r²) − R the tip's underside, φ = h + ψ is the apex height at which an element would be
///           touched, and
///             S = Σ e^{φ/t} dA,  dA = (R/q) d²s,  q = √(R² − r²)  (the tip's own area)
///           so that −w e^{−z/t} S is the energy at apex height z. ⟨·⟩ being the mean with that weight,
///             H = ⟨φ⟩ + t,  c = ⟨n_z⟩ + cov(n_z, φ)/t,  R_eff = S e^{−H/t}/(2π t c),  n_z = q/R.
/// Planes    A plane of normal n at cosine c: the normal distance u of the tip's elements is uniform in area
///           (Archimedes: dA = 2πR du), the vertical gap u/c, so S = 2πR t c e^{H/t} with H = R(1/c − 1):
///           height, cosine (⟨n_z⟩ = c − (t/R)c² is led to t = 0 by its own derivative) and R_eff = R are
///           exact, but for what lies beyond the tip's rim, e^{−R(1 − sin θ)/(tc)} or so.
/// Feet      One foot of relative curvatures λ₁, λ₂: R_eff = 1/√(λ₁λ₂) (1 + O(t/R_eff)), H to O(t²/R_eff).
///           Feet add: two equal ones have their height and cosine, and twice the radius.
/// Rim       R/q has no end at r = R: from the angle of cosine kConeCosine on the underside goes on as its
///           tangent cone. Beyond the rim of the scan its mirror image is taken.
/// Coarse    For t > R/20 the sphere ends within a few t, so the paraboloid ψ = −r²/2R with plain area is
///           taken. On a plane of slope s its H is R s²/2: s² = (⟨r²⟩ + cov(r², φ)/t)/R² (again led to t = 0)
///           puts it right, H − R s²/2 + R(1/c − 1), c = 1/√(1 + s²): planes stay exact, on curved slopes the
///           foot is that of the paraboloid.
/// Pull-off  ρ as above is the radius of one foot within t. A rigid tip is held by all that is within the range of
///           the attraction, an elastic one by what it can reach until it lets go; so the areas of the tip are
///           sorted by their normal depth c (H − φ), and ρ rises by what the force of those is over that of a
///           single foot (retraction_kernel.h). On planes, balls and paraboloids nothing rises, but for the
///           midpoint rule's error over areas (some 1e-3).
/// Walls     A paraboloid is wider than its ball: it meets a wall of height R at √2 R from the axis, and what puts
///           its H right is then wrong by as much as the wall is high. With D = max φ of the ball, 0, 1 or 2
///           directions in which φ falls off from there and a peak at worst, the ball's H is within t of D.
///           Where the paraboloid's is not, by x in units of t, or its cosine is less than the ball's by more
///           than kFlatter (1 + x), the node goes over to the sums of the ball itself, by 3x² − 2x³ up to x =
///           1. It is looked at where the slope that is felt is above kFarFoot.
/// Sums      over sub-samples of the height spline, midpoint rule in two dimensions: its error is 2 exp(−2π²
///           R_f t/s²) or so, R_f the foot's radius along the line (R c³ up a slope). What adds less than
///           e^{−25} of the largest term is left out.
/// Bits      det_math, fixed order: the same on every x86-64, in whatever registers, and a node's values do
///           not depend on which other nodes are made.
inline constexpr double kConeCosine = 0.2;

/// Nodes from the first sample to the last, `m` sub-samples to a node along either side.
struct DilationLattice {
  double x_first_nm = 0, y_first_nm = 0;
  double node_dx_nm = 1, node_dy_nm = 1;
  int columns = 2, rows = 2;  ///< of nodes, both rims included
  int m = 1;
};

/// The lattice for nodes at most `node_nm` apart with sub-samples at most `sample_nm` apart.
DilationLattice dilation_lattice(const BicubicSpline& height, double node_nm, double sample_nm);

/// `m` for sub-samples at most `sample_nm` apart.
int sub_samples(const DilationLattice& lattice, double sample_nm) noexcept;

struct DilatedNode {
  double height_nm = 0;   ///< H
  double log_radius = 0;  ///< ρ = ln(R_eff/nm)
  double cosine = 1;      ///< c, in [kConeCosine, 1]
};

/// Registers that sums are made in. Both add the same numbers in the same order: the same bits.
enum class Lanes {
  kTwo,   ///< SSE2
  kFour,  ///< AVX
};
/// The most that this processor has.
Lanes widest_lanes() noexcept;

/// One softening length. Throws UserError if radius or softening are not positive.
class Dilation {
 public:
  /// `height` must outlive it. `relief_nm` is at least the highest sample less the lowest.
  /// With a kernel, which must outlive it, ρ is that of the ground's pull-off (Pull-off above).
  Dilation(const BicubicSpline& height, const DilationLattice& lattice, double tip_radius_nm,
           double softening_nm, double relief_nm, Lanes lanes = widest_lanes(),
           const RetractionKernel* kernel = nullptr);

  /// The tile of kTile × kTile nodes with this number across and along (fewer at the far rims), row-major.
  static constexpr int kTile = 64;
  void make_tile(int tile_column, int tile_row, std::vector<DilatedNode>& nodes) const;
  /// For who makes small rectangles, one after the other: what a whole tile must be looked at for is kept.
  void remember_tiles();
  /// The nodes of any rectangle, row-major: the same bits.
  void make_rectangle(int first_column, int first_row, int columns, int rows,
                      std::vector<DilatedNode>& nodes) const;
  int tile_columns() const noexcept { return (lattice_.columns + kTile - 1) / kTile; }
  int tile_rows() const noexcept { return (lattice_.rows + kTile - 1) / kTile; }

  /// All tiles, row-major over the lattice. Of a level ground one node is made, which all are. `made`, if
  /// given, hears after each tile which part is done, from 0 to 1.
  std::vector<DilatedNode> make_all(const std::function<void(double)>& made = {}) const;

  const DilationLattice& lattice() const noexcept { return lattice_; }

 private:
  std::size_t tile_number(int column, int row) const noexcept {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(tile_columns()) +
           static_cast<std::size_t>(column);
  }
  static constexpr int kBlock = 4;
  /// Kernel of a block of 4 × 4 sub-samples: weight times e^{ψ/t}, that times the moment (n_z or r²), and ψ.
  struct Block {
    double weight[16];
    double moment[16];
    double profile[16];
  };
  struct Sums {
    double s = 0, phi = 0, moment = 0, moment_phi = 0;
  };
  struct Window;
  struct Nodes {
    int i0, j0, nx, ny;
    Nodes common(const Nodes& other) const noexcept;
  };
  void fill_window(const Nodes& part, const PartExtremes::Part& id, const Nodes& wanted,
                   Window& window) const;
  void make_part(const Nodes& part, const PartExtremes::Part& id, const Nodes& wanted,
                 DilatedNode* nodes) const;
  template <class Use>
  void each_block(const Window& window, int i, int j, const Use& use) const;
  struct Pair {
    const double* height;
    const double* boosted;
    const Block* kernel;
  };
  static void sum_two(const Pair* pairs, std::size_t count, Sums& sums) noexcept;
  static void sum_four(const Pair* pairs, std::size_t count, Sums& sums) noexcept;
  Sums sum_node(const Window& window, int i, int j, std::vector<Pair>& pairs) const;
  Sums sum_slowly(const Window& window, int i, int j, double& reference) const;
  DilatedNode fields_of(const Sums& sums, double reference, bool paraboloid) const;
  double pull_off_rise(const std::vector<Pair>& pairs, double height, const DilatedNode& node) const;
  DilatedNode within_ball(const Window& window, int i, int j, const DilatedNode& node) const;
  double ball_profile_at(double r2) const noexcept;
  double profile_at(double r2) const noexcept;
  void weight_at(double psi, double& weight, double& moment) const noexcept;

  const BicubicSpline* height_;
  DilationLattice lattice_;
  double radius_, t_;
  Lanes lanes_;
  const RetractionKernel* pull_off_;  // null: none
  bool level_;                        // all nodes are one
  bool paraboloid_;
  double dx_, dy_;                          // of sub-samples
  int reach_;                               // blocks to either side
  int alignments_;                          // places of a node within a block, along one side
  std::vector<Block> kernel_;               // [align_y][align_x][block row][block column]
  std::vector<float> most_, least_;         // of ψ in a block
  std::unique_ptr<PartExtremes> extremes_;  // null: each window is looked at anew
};

}  // namespace telenano::physics

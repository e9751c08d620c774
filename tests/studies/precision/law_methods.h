#pragma once

#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace telenano::studies {

/// One way to evaluate the dimensionless Maugis–Dugdale force P(Delta) with the overlap held, for one lambda.
class LawMethod {
 public:
  virtual ~LawMethod() = default;
  /// Along a path in this order; memory, where a method has any, starts empty.
  virtual void run(std::span<const double> overlaps, double* loads) = 0;
};

/// Maugis–Dugdale in contact by plain Newton on theta to the end, well away from fold and onset: force and
/// stiffness that owe nothing to the product's code, for studies of what is built upon the law.
class InContact {
 public:
  struct State {
    double load = 0;
    double slope = 0;
  };
  explicit InContact(double lambda) : lambda_(lambda), theta_(lambda < 1 ? 1.0 : 0.8 / lambda) {}
  State at(double overlap);

 private:
  double lambda_;
  double theta_;
};

/// Adding a method to the study is adding an entry to law_methods().
struct LawMethodEntry {
  std::string family;
  std::string setting;
  bool is_default = false;
  std::function<std::unique_ptr<LawMethod>(double lambda)> make;
  bool is_knob = true;  ///< its settings go from coarse to fine (not: different laws)
};

/// The largest overlap that the tables of this study cover.
inline constexpr double kTableOverlap = 31;

/// The product's own methods, and what else could have been taken: textbook Newton iterations, bisection,
/// tables, closed forms. Those that are not the product's are written here from Maugis' equations.
std::vector<LawMethodEntry> law_methods();

// The entries by kind; law_methods() joins them.
std::vector<LawMethodEntry> product_law_methods();
std::vector<LawMethodEntry> iterative_law_methods();
std::vector<LawMethodEntry> table_law_methods();
std::vector<LawMethodEntry> closed_law_methods();

}  // namespace telenano::studies

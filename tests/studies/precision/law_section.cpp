#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>

#include "tests/studies/precision/law_methods.h"
#include "tests/studies/precision/studies.h"
#include "tests/support/md_oracle.h"

namespace telenano::studies {
namespace {

/// Overlaps in the order in which they are visited, and the exact load at every `stride`-th.
struct Path {
  std::string condition;
  std::vector<double> overlaps;
  std::size_t stride = 1;
  std::vector<double> exact{};
};

// One tick of a hand that moves: 0.1 u_delta, some 20-50 nm/s at 1 kHz on hard samples.
Path deep_path(const std::string& name) {
  Path path{name + ", contact", {}};
  for (int i = 0; i < 300; ++i) path.overlaps.push_back(30.0 - 0.1 * i);
  return path;
}

// Down to 1e-10 above the fold, 12 points a decade: every step comes 18 % nearer.
Path fold_path(const std::string& name, const oracle::MaugisDugdale& oracle) {
  Path path{name + ", near the fold", {}};
  for (int i = 0; i <= 108; ++i) path.overlaps.push_back(oracle.above_fold(std::pow(10.0, -1 - i / 12.0)));
  return path;
}

// From 0.1 above the onset of contact to 0.1 below it (there the branch before contact is stable).
Path onset_path(const std::string& name, const oracle::MaugisDugdale& oracle) {
  Path path{name + ", at the onset", {}};
  const double onset = oracle.onset_overlap();
  for (int i = 0; i <= 84; ++i) path.overlaps.push_back(onset + std::pow(10.0, -1 - i / 12.0));
  const double room = 0.9 * (onset - oracle.fold_overlap());
  for (int i = 84; i >= 0; --i) {
    const double below = std::pow(10.0, -1 - i / 12.0);
    if (below < room) path.overlaps.push_back(onset - below);
  }
  return path;
}

Row evaluate(const LawMethodEntry& entry, double lambda, const Path& path, double scale,
             const Effort& effort) {
  const auto begin = std::chrono::steady_clock::now();
  const auto method = entry.make(lambda);
  Row row{path.condition, entry.family, entry.setting, entry.is_default, {}, {}};
  row.is_knob = entry.is_knob;
  row.setup_us = 1e6 * std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  std::vector<double> loads(path.overlaps.size());
  method->run(path.overlaps, loads.data());
  std::vector<double> errors;
  for (std::size_t k = 0; k < path.exact.size(); ++k) {
    errors.push_back(std::fabs(loads[k * path.stride] - path.exact[k]) / (std::fabs(path.exact[k]) + scale));
  }
  row.errors = summarise(errors);
  row.cost = measure([&] { method->run(path.overlaps, loads.data()); }, path.overlaps.size(), effort);
  return row;
}

}  // namespace

Section law_section(const Effort& effort, const FigureFolder& folder) {
  Section section;
  section.id = "law";
  section.title = "Contact law: evaluation of Maugis–Dugdale";
  section.lead =
      "Force with the overlap held, against bisection of Maugis' own equations in 50-digit arithmetic. "
      "Error: |P − exact| / (|exact| + pull-off). Every method walks the same path of overlaps and may use "
      "where it was; only the whole call of the loop also gives branch, stiffness, contact radius, energy "
      "and units.";
  section.choice =
      "Default: the direct method on u = cot²θ, warm. In contact, near folds and at the onset it is at "
      "rounding for every λ, with branch, stiffness, radius and energy in the same call, in about a "
      "thousandth of the 250 µs of a 4 kHz tick; and it needs nothing prepared when the local radius, and "
      "with it λ, changes from step to step on a curved sample, where building a table costs as much "
      "as some three thousand evaluations. Plain Newton on θ gets as far with five steps when warm, in more "
      "time, but "
      "needs twenty when cold, near the fold and at the onset, where Δ(θ) is flat. Newton on m loses its "
      "digits as λ grows (m − 1 is 7e-12 at λ = 1e4). A bare table is forty times faster, but in the "
      "loop's call, with branch, radius, energy and units, the product's table saves half of the time at an "
      "error below 1e-9, for 0.5 to 0.8 ms of preparation: worth it where λ is fixed and sessions are many, "
      "on a flat sample. Hertz, DMT, JKR, Schwarz, COS and Piétrement–Troyon err by their model, whatever "
      "the computer does: Piétrement–Troyon is the best over all λ, JKR from λ = 4 on; COS and Piétrement–"
      "Troyon take as long as the exact law. What lets go before the exact law does counts with its whole "
      "force near the fold.";
  const std::pair<double, const char*> lambdas[] = {{0.1, "λ = 0.1"},
                                                    {0.73676, "λ = 0.737 (silicon oxide)"},
                                                    {4.04149, "λ = 4.04 (polystyrene)"},
                                                    {408.71, "λ = 409 (PDMS)"},
                                                    {1e4, "λ = 10 000"}};
  std::vector<Row> deep, fold, onset;
  for (const auto& [lambda, name] : lambdas) {
    const oracle::MaugisDugdale oracle(lambda);
    const double scale = -oracle.pull_off_load();
    std::vector<std::pair<Path, std::vector<Row>*>> paths;
    paths.emplace_back(deep_path(name), &deep);
    paths.emplace_back(fold_path(name, oracle), &fold);
    // Where the onset is on the stable curve at all.
    if (!oracle.fold_in_contact()) paths.emplace_back(onset_path(name, oracle), &onset);
    for (auto& [path, rows] : paths) {
      path.stride = effort.quick ? 10 : 1;
      for (std::size_t i = 0; i < path.overlaps.size(); i += path.stride)
        path.exact.push_back(oracle.at_overlap(path.overlaps[i]).load);
      for (const LawMethodEntry& entry : law_methods())
        rows->push_back(evaluate(entry, lambda, path, scale, effort));
    }
  }
  const auto add = [&](const std::vector<Row>& rows, const char* id, const char* title, const char* caption) {
    section.rows.insert(section.rows.end(), rows.begin(), rows.end());
    section.figures.push_back(work_precision_figure({id, title, caption, ""}, rows, "largest error", folder));
  };
  add(deep, "law_contact", "In contact",
      "Overlaps from 30 to 0.1 u_δ in steps of 0.1. Lower left is better; a line joins the settings of one "
      "method from coarse to fine, the ring marks the default; different laws are not joined.");
  add(fold, "law_fold", "Near the fold",
      "Retracting to 1e-10 above the overlap at which the tip lets go. The force has a square root there, so "
      "that rounding of the overlap alone makes some 1e-11; above, a method's error is its own.");
  add(onset, "law_onset", "At the onset of contact",
      "Through the overlap at which contact begins on the stable curve (λ < 0.938 only).");
  return section;
}

}  // namespace telenano::studies

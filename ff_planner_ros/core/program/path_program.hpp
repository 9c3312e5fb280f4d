// The optimisation problem of Eq. (43) on a time grid: objectives and requirements as functions of
// a path, with their derivatives.
#pragma once
#include "program/path_objective.hpp"
#include "program/path_requirement.hpp"

namespace ff {

// Difference between a path's motion and the controller's interpolation of the plan's points, which
// requirements are asked of: tangent steps at the points and half-way, and differences of
// velocities at the points. Its own derivatives are neglected.
struct Correction {
  RowMajor q, v;

  void apply(PathMotion& to) const;
};

class PathProgram {
 public:
  // No requirement has as many rows: the names of all of them differ. Those of one lie on both
  // sides of zero.
  static constexpr long long kNames = 1LL << 40;

  // A requirement with its number, by which the names of its rows differ from those of others.
  struct Numbered {
    long long number;
    std::shared_ptr<const PathRequirement> requirement;
  };

  PathProgram(std::shared_ptr<const PathsOnGrid> paths, double step, PathObjective objective,
              std::vector<Numbered> requirements, std::optional<Correction> correction)
      : paths_(std::move(paths)),
        step_(step),
        objective_(std::move(objective)),
        requirements_(std::move(requirements)),
        correction_(std::move(correction)) {}

  Eigen::Index variables() const { return paths_->variables(); }

  EvaluatedPath at(const Eigen::VectorXd& x);

 private:
  ConstraintRows rows_of(const PathMotion& motion) const;

  std::shared_ptr<const PathsOnGrid> paths_;
  double step_;
  PathObjective objective_;
  std::vector<Numbered> requirements_;
  std::optional<Correction> correction_;
  PathDerivatives by_x_;  // of the last path: what evaluated paths keep is much smaller
};

}  // namespace ff

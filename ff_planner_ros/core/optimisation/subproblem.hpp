// The quadratic subproblem of an SQP step.
//
//     minimise    grad f' d + d' H d / 2 + t + penalty s   over the step d, t and the slack s >= 0
//     subject to  p + P d <= t,  g + G d + s >= 0,  h + E d = 0,  max |d| <= radius
//
// The max terms are in epigraph form. Elastic mode: if the linearised equalities have no solution
// within the trust region, the same slack relaxes them to either side. Their multipliers are then
// not reliable.
#pragma once
#include <algorithm>
#include <limits>
#include <optional>

#include "optimisation/dual_active_set.hpp"

namespace ff {

// The functions of a nonlinear program and their first derivatives at one x, as linearisation.py
// has them; constraints of equal names are equal.
struct Functions {
  double value;
  Values gradient;
  Rows hessian;
  Values max_terms;
  Rows max_terms_jacobian;
  Values constraints;
  Rows constraints_jacobian;
  Values equalities;
  Rows equalities_jacobian;
  std::vector<long long> names;  // empty: as they are numbered
  bool is_defined = true;        // at x; if not, ignore the values

  double objective() const { return value + (max_terms.size() > 0 ? max_terms.maxCoeff() : 0); }
  double violation() const;
  // The same with others that are kept elsewhere.
  Functions with_hessian(const RowMajor& other) const;
  Functions with_equalities(const Eigen::VectorXd& other) const;
};

// What a step keeps with equality: where the next step's solution is looked for first.
struct WorkingSet {
  std::vector<long long> constraints;  // their names
  std::vector<int> max_terms;          // that are the largest
  std::vector<int> lower, upper;       // entries of (d, t, s) at their bounds
};

struct Step {
  Eigen::VectorXd dx;
  double objective = 0;  // of the model at the end of the step
  double violation = 0;  // of the linearised constraints there
  Eigen::VectorXd on_constraints, on_equalities, on_max_terms;
  double optimality = 0;  // first-order, at the step's beginning with its multipliers
  WorkingSet working_set;
  bool is_elastic = false;
};

class Subproblem {
 public:
  Subproblem(const Functions& at_x, double radius, double penalty, double inside, bool elastic);

  // Whether there is a step, which is written; without equalities one is. guess: of a step before,
  // with the same variables.
  bool solve(const std::optional<WorkingSet>& guess, Step& to);

 private:
  struct Constraint {
    double value;
    Rows::ConstRowXpr by_x;  // times the sign
    double sign;
  };

  // by_x d + the linear variable >= least, divided by its size: beside a singularity derivatives
  // are of any size, and rounding with them.
  template <typename Row>
  void write_row(int row, const Row& by_x, int linear, double least) {
    auto to = program_.rows.row(row);
    to.head(n_) = by_x;
    to[linear] = 1;
    const double size = to.lpNorm<Eigen::Infinity>();
    if (size > 1) to /= size;
    program_.least[row] = least / size;
    sizes_[row] = size;
  }

  // A constraint, or in elastic mode a side of an equality.
  Constraint constraint(int row) const;
  long long name(int row) const;

  std::vector<int> numbers(const std::optional<WorkingSet>& guess) const;

  void write(const Eigen::VectorXd& x, const Eigen::VectorXd& of_equalities,
             const Eigen::VectorXd& of_rows, const Eigen::VectorXd& of_bounds, Step& to) const;

  // Makes the programs strictly convex; the objective's own curvature is of order 1. The epigraph
  // variable and the slack are linear, and have this part of it.
  static constexpr double kRegularisation = 1e-4, kLinear = 1e-4;
  // The second is left where constraints nearly depend on each other, still well inside.
  static constexpr double kTolerance = 1e-9, kLooseTolerance = 1e-7;
  static constexpr double kUnbounded = 1e30;  // a bound so far away is none

  const Functions& at_;
  const int n_, sides_, rows_;
  const double largest_;
  QuadraticProgram program_;
  Eigen::VectorXd sizes_;  // that its rows were divided by
};

// The step that minimises the model of the merit function in the trust region. It aims so far
// inside the constraints.
Step solve_subproblem(const Functions& at_x, double radius, double penalty, double inside,
                      const std::optional<WorkingSet>& guess, bool elastic);

}  // namespace ff

// The dual active-set method for strictly convex quadratic programs: D. Goldfarb and A. Idnani, "A
// numerically stable dual method for solving strictly convex quadratic programs", 1983. Its names.
#pragma once
#include <limits>
#include <vector>

#include "kinematics/chain.hpp"

namespace ff {

// Minimise x' hessian x / 2 + gradient' x  subject to  equal_rows x = equal, rows x >= least,
// lower <= x <= upper. Constraints have numbers: the rows, the lower, then the upper bounds.
struct QuadraticProgram {
  RowMajor hessian;
  Eigen::VectorXd gradient;
  RowMajor equal_rows;
  Eigen::VectorXd equal;
  RowMajor rows;
  Eigen::VectorXd least, lower, upper;
};

class DualActiveSet {
 public:
  enum Outcome { kSolved, kInfeasible, kUndecided };

  // tolerance: of constraints, and of gradients relative to the largest entry.
  DualActiveSet(const QuadraticProgram& program, double tolerance)
      : program_(program),
        tolerance_(tolerance),
        n_(program.gradient.size()),
        rows_(program.least.size()) {}

  // Begins with the constraints of a guess, as far as they are independent.
  Outcome solve(const std::vector<int>& guess);

  Eigen::VectorXd x;
  // Multipliers of the equalities, the rows and the bounds, those of upper bounds negative:
  // gradient + hessian x is the sum of each times its constraint's gradient.
  Eigen::VectorXd of_equalities, of_rows, of_bounds;

 private:
  using Matrix = Eigen::MatrixXd;
  using Vector = Eigen::VectorXd;

  // J = U^-1, which is upper triangular, too: a third of the operations of a general solve.
  void invert(const Matrix& U);

  // x and multipliers of the active constraints alone; drops those whose multiplier is negative.
  void settle();

  // Those that are violated at least half as much as the worst. Each is looked at again before
  // every constraint that enters; the others, which often are not violated then, wait for the next
  // look.
  std::vector<int> violated_rows() const;

  // Until none of these rows and no bound is violated.
  Outcome enter_violated(const std::vector<int>& rows);

  // Makes a violated constraint active, and drops those whose multiplier becomes zero on the way.
  Outcome enter(int entering);

  // Whether a constraint of gradient n is independent of the active ones. d: J' n.
  bool is_independent(const Vector& d) const;

  // Adds a constraint to the active ones; not one that depends on them.
  bool append_independent(int number);

  // Adds a constraint of gradient n to the factorisation. d: J' n; z = J2 d2, of its part across
  // the active ones. z is computed from this J and d, or rounding spoils J J'.
  void append(int number, const Vector& d, const Vector& z);

  // Drops an active constraint. d: J' times any vector, changes with J.
  void drop(int j, Vector& d);

  double slack(int number) const;

  double bound(int number) const;

  // J' times the constraint's gradient.
  Vector across(int number) const;

  // The conditions of Karush, Kuhn and Tucker, as far as rounding may have broken them.
  bool is_optimal();

  int equalities() const { return program_.equal.size(); }
  int size() const { return active_.size(); }

  // Part of a constraint's gradient across those of the active ones, that rounding alone may leave.
  static constexpr double kDependent = 1e-9;
  // Of 14,000 programs of searches 8 took more. Constraints that nearly depend on each other may
  // take turns for ever.
  static constexpr int kMostExchanges = 1000;

  const QuadraticProgram& program_;
  const double tolerance_;
  const int n_, rows_;
  std::vector<int> active_;  // the equality i as -1 - i, these first
  // J' N = [R; 0] for the active constraints' gradients N, and J J' is the inverse Hessian.
  Matrix J_, R_;
  Vector bound_, u_;  // right sides and multipliers of the active constraints
  int exchanges_ = 0;
};

}  // namespace ff

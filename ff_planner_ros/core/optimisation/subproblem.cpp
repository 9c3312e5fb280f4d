#include "optimisation/subproblem.hpp"

namespace ff {

double Functions::violation() const {
  if (!is_defined) return std::numeric_limits<double>::infinity();
  const double below = constraints.size() > 0 ? -constraints.minCoeff() : 0;
  return std::max({0.0, below, equalities.lpNorm<Eigen::Infinity>()});
}

Functions Functions::with_hessian(const RowMajor& other) const {
  Functions found = *this;
  new (&found.hessian) Rows(other.data(), other.rows(), other.cols());
  return found;
}

Functions Functions::with_equalities(const Eigen::VectorXd& other) const {
  Functions found = *this;
  new (&found.equalities) Values(other.data(), other.size());
  return found;
}

Subproblem::Subproblem(const Functions& at_x, double radius, double penalty, double inside,
                       bool elastic)
    : at_(at_x),
      n_(at_x.gradient.size()),
      sides_(elastic ? 2 * static_cast<int>(at_x.equalities.size()) : 0),
      rows_(static_cast<int>(at_x.constraints.size()) + sides_),
      largest_(at_x.max_terms.size() > 0 ? at_x.max_terms.maxCoeff() : 0) {
  const int max_terms = static_cast<int>(at_.max_terms.size());
  const bool has_max = max_terms > 0;
  program_.hessian.setZero(n_ + 2, n_ + 2);
  program_.hessian.topLeftCorner(n_, n_) = at_.hessian;
  program_.hessian.diagonal().head(n_).array() += kRegularisation;
  program_.hessian.diagonal().tail(2).setConstant(kRegularisation * kLinear);
  program_.gradient.resize(n_ + 2);
  program_.gradient << at_.gradient, has_max ? 1.0 : 0.0, penalty;
  if (!elastic) {
    program_.equal_rows.setZero(at_.equalities.size(), n_ + 2);
    program_.equal_rows.leftCols(n_) = at_.equalities_jacobian;
    program_.equal = -at_.equalities;
  } else {
    program_.equal_rows.resize(0, n_ + 2);
  }
  program_.rows.setZero(rows_ + max_terms, n_ + 2);
  program_.least.resize(rows_ + max_terms);
  sizes_.resize(rows_ + max_terms);
  for (int row = 0; row < rows_; ++row) {
    const auto [value, by_x, sign] = constraint(row);
    write_row(row, sign * by_x, n_ + 1, inside - value);
  }
  // Max terms are measured from the present largest, so that t stays small.
  for (int term = 0; term < max_terms; ++term)
    write_row(rows_ + term, -at_.max_terms_jacobian.row(term), n_, at_.max_terms[term] - largest_);
  program_.lower.setConstant(n_ + 2, -radius);
  program_.upper.setConstant(n_ + 2, radius);
  program_.lower.tail(2) << (has_max ? -std::max(std::abs(largest_), 1.0) : 0.0), 0;
  program_.upper.tail(2) << (has_max ? kUnbounded : 0.0), kUnbounded;
}

bool Subproblem::solve(const std::optional<WorkingSet>& guess, Step& to) {
  std::vector<int> first = numbers(guess);
  auto diagonal = program_.hessian.diagonal().head(n_);
  const double largest = diagonal.maxCoeff();
  struct Attempt {
    double more, tolerance;  // that is added to the Hessian; of the solution
  };
  // The last two add more than rounding takes away from a Hessian.
  for (const Attempt& attempt : {Attempt{0, kTolerance}, Attempt{0, kLooseTolerance},
                                 Attempt{1e-2 + 1e-12 * largest, kLooseTolerance},
                                 Attempt{1 + 1e-8 * largest, kLooseTolerance}}) {
    diagonal.array() += attempt.more;
    DualActiveSet solver(program_, attempt.tolerance);
    const DualActiveSet::Outcome outcome = solver.solve(first);
    if (outcome == DualActiveSet::kSolved) {
      solver.of_rows.array() /= sizes_.array();
      write(solver.x, solver.of_equalities, solver.of_rows, solver.of_bounds, to);
      return true;
    }
    // With equalities the slack leaves no solution; without, it does, whatever rounding says.
    if (outcome == DualActiveSet::kInfeasible && program_.equal.size() > 0) return false;
    first.clear();
  }
  if (program_.equal.size() > 0) return false;
  // Rounding leaves no step: none.
  const auto zero = [](int size) -> Eigen::VectorXd { return Eigen::VectorXd::Zero(size); };
  write(zero(n_ + 2), zero(0), zero(rows_ + at_.max_terms.size()), zero(n_ + 2), to);
  return true;
}

Subproblem::Constraint Subproblem::constraint(int row) const {
  const int constraints = static_cast<int>(at_.constraints.size());
  if (row < constraints) return {at_.constraints[row], at_.constraints_jacobian.row(row), 1};
  const int equality = (row - constraints) / 2;
  const double sign = (row - constraints) % 2 == 0 ? 1 : -1;
  return {sign * at_.equalities[equality], at_.equalities_jacobian.row(equality), sign};
}

long long Subproblem::name(int row) const {
  if (row < static_cast<int>(at_.names.size())) return at_.names[row];
  return std::numeric_limits<long long>::min() + row - static_cast<int>(at_.names.size());
}

std::vector<int> Subproblem::numbers(const std::optional<WorkingSet>& guess) const {
  const int bounds = static_cast<int>(program_.least.size()), variables = n_ + 2;
  // t and s, which hardly have a curvature, begin at a bound.
  if (!guess) return {bounds + n_, bounds + n_ + 1};
  std::vector<int> found;
  for (int row = 0; row < rows_; ++row)
    if (std::binary_search(guess->constraints.begin(), guess->constraints.end(), name(row)))
      found.push_back(row);
  for (const int term : guess->max_terms)
    if (rows_ + term < bounds) found.push_back(rows_ + term);
  for (const int i : guess->lower)
    if (i < variables) found.push_back(bounds + i);
  for (const int i : guess->upper)
    if (i < variables) found.push_back(bounds + variables + i);
  return found;
}

void Subproblem::write(const Eigen::VectorXd& x, const Eigen::VectorXd& of_equalities,
                       const Eigen::VectorXd& of_rows, const Eigen::VectorXd& of_bounds,
                       Step& to) const {
  to.is_elastic = sides_ > 0;
  to.dx = x.head(n_);
  to.on_constraints = of_rows.head(at_.constraints.size());
  to.on_max_terms = of_rows.tail(at_.max_terms.size());
  to.on_equalities = Eigen::VectorXd::Zero(at_.equalities.size());
  if (to.is_elastic)
    for (int row = static_cast<int>(at_.constraints.size()); row < rows_; ++row)
      to.on_equalities[(row - at_.constraints.size()) / 2] -= constraint(row).sign * of_rows[row];
  else
    to.on_equalities = -of_equalities;
  Eigen::VectorXd lagrangian = at_.gradient;
  lagrangian.noalias() -= at_.constraints_jacobian.transpose() * to.on_constraints;
  lagrangian.noalias() += at_.max_terms_jacobian.transpose() * to.on_max_terms;
  lagrangian.noalias() += at_.equalities_jacobian.transpose() * to.on_equalities;
  to.optimality = lagrangian.lpNorm<Eigen::Infinity>();
  double below = 0;  // lowest of the linearised constraints
  for (int row = 0; row < rows_; ++row) {
    const double multiplier = of_rows[row];
    const auto [value, by_x, sign] = constraint(row);
    to.optimality = std::max(to.optimality, multiplier * std::max(value, 0.0));
    below = std::min(below, value + sign * by_x.dot(to.dx));
    if (multiplier > 0) to.working_set.constraints.push_back(name(row));
  }
  std::sort(to.working_set.constraints.begin(), to.working_set.constraints.end());
  to.violation = -below;
  if (!to.is_elastic && at_.equalities.size() > 0)
    to.violation = std::max(
        to.violation, (at_.equalities + at_.equalities_jacobian * to.dx).lpNorm<Eigen::Infinity>());
  to.objective = at_.value + at_.gradient.dot(to.dx) + to.dx.dot(at_.hessian * to.dx) / 2;
  if (to.on_max_terms.size() > 0)
    to.objective += (at_.max_terms + at_.max_terms_jacobian * to.dx).maxCoeff();
  for (int term = 0; term < to.on_max_terms.size(); ++term) {
    to.optimality =
        std::max(to.optimality, to.on_max_terms[term] * (largest_ - at_.max_terms[term]));
    if (to.on_max_terms[term] > 0) to.working_set.max_terms.push_back(term);
  }
  for (int i = 0; i < n_ + 2; ++i)
    if (of_bounds[i] != 0)
      (of_bounds[i] > 0 ? to.working_set.lower : to.working_set.upper).push_back(i);
}

Step solve_subproblem(const Functions& at_x, double radius, double penalty, double inside,
                      const std::optional<WorkingSet>& guess, bool elastic) {
  Step step;
  if (elastic || !Subproblem(at_x, radius, penalty, inside, false).solve(guess, step))
    Subproblem(at_x, radius, penalty, inside, true).solve(guess, step);
  return step;
}

}  // namespace ff

#include "optimisation/dual_active_set.hpp"

#include "kinematics/cholesky.hpp"

namespace ff {

DualActiveSet::Outcome DualActiveSet::solve(const std::vector<int>& guess) {
  const Eigen::LLT<Matrix> factors = cholesky(Matrix(program_.hessian));
  if (factors.info() != Eigen::Success) return kUndecided;
  invert(factors.matrixU().toDenseMatrix());
  R_.setZero(n_, n_);
  bound_.resize(n_);
  for (int i = 0; i < program_.equal.size(); ++i)
    if (!append_independent(-1 - i)) return kUndecided;  // equalities that depend on each other
  for (const int i : guess) append_independent(i);
  while (exchanges_ < kMostExchanges) {
    settle();
    const int before = exchanges_;
    const Outcome entered = enter_violated(violated_rows());
    if (entered != kSolved) return entered;
    if (exchanges_ == before) return is_optimal() ? kSolved : kUndecided;
  }
  return kUndecided;
}

void DualActiveSet::invert(const Matrix& U) {
  J_.setZero(n_, n_);
  for (int j = 0; j < n_; ++j) {
    J_(j, j) = 1 / U(j, j);
    J_.col(j).head(j).noalias() = J_.topLeftCorner(j, j) * (U.col(j).head(j) * -J_(j, j));
  }
}

void DualActiveSet::settle() {
  Vector along = J_.transpose() * program_.gradient, step;
  for (;;) {
    const auto R = R_.topLeftCorner(size(), size()).triangularView<Eigen::Upper>();
    step = -along;
    step.head(size()) = R.transpose().solve(bound_.head(size()));
    u_ = R.solve(step.head(size()) + along.head(size()));
    int worst = -1;
    double lowest = 0;
    for (int j = equalities(); j < size(); ++j)
      if (u_[j] < lowest) lowest = u_[worst = j];
    if (worst < 0) break;
    drop(worst, along);
  }
  x.noalias() = J_ * step;
}

std::vector<int> DualActiveSet::violated_rows() const {
  std::vector<int> violated;
  const Vector slack = program_.rows * x - program_.least;
  const double most = rows_ > 0 ? slack.minCoeff() / 2 : 0;
  for (int i = 0; i < rows_; ++i)
    if (slack[i] < -tolerance_ && slack[i] <= most) violated.push_back(i);
  return violated;
}

DualActiveSet::Outcome DualActiveSet::enter_violated(const std::vector<int>& rows) {
  for (;;) {
    int worst = -1;
    double lowest = -tolerance_;
    const auto consider = [&](int i, double slack) {
      if (slack < lowest) lowest = slack, worst = i;
    };
    for (const int i : rows) consider(i, slack(i));
    Eigen::Index at = 0;
    const double above_lower = (x - program_.lower).minCoeff(&at);
    consider(rows_ + at, above_lower);
    const double below_upper = (program_.upper - x).minCoeff(&at);
    consider(rows_ + n_ + at, below_upper);
    if (worst < 0) return kSolved;
    const Outcome entered = enter(worst);
    if (entered != kSolved) return entered;
  }
}

DualActiveSet::Outcome DualActiveSet::enter(int entering) {
  double multiplier = 0;
  Vector d = across(entering);
  while (exchanges_ < kMostExchanges) {
    constexpr double infinite = std::numeric_limits<double>::infinity();
    const Vector r =
        R_.topLeftCorner(size(), size()).triangularView<Eigen::Upper>().solve(d.head(size()));
    int blocking = -1;
    double partial = infinite;
    for (int j = equalities(); j < size(); ++j)
      if (r[j] > 0 && u_[j] < partial * r[j]) partial = u_[blocking = j] / r[j];
    const Vector z = J_.rightCols(n_ - size()) * d.tail(n_ - size());
    const double square = d.tail(n_ - size()).squaredNorm();
    const double full = is_independent(d) ? -slack(entering) / square : infinite;
    const double step = std::min(partial, full);
    if (step == infinite) return kInfeasible;
    u_ -= step * r;
    multiplier += step;
    if (full < infinite) x += step * z;
    if (full <= partial) {
      append(entering, d, z);
      u_.conservativeResize(size());
      u_[size() - 1] = multiplier;
      return kSolved;
    }
    drop(blocking, d);
  }
  return kUndecided;
}

bool DualActiveSet::is_independent(const Vector& d) const {
  return d.tail(n_ - size()).squaredNorm() > kDependent * kDependent * d.squaredNorm();
}

bool DualActiveSet::append_independent(int number) {
  const Vector d = across(number);
  if (!is_independent(d)) return false;
  append(number, d, J_.rightCols(n_ - size()) * d.tail(n_ - size()));
  return true;
}

void DualActiveSet::append(int number, const Vector& d, const Vector& z) {
  auto J2 = J_.rightCols(n_ - size());
  Vector v = d.tail(n_ - size());
  const double length = v[0] > 0 ? -v.norm() : v.norm();
  R_.col(size()).head(size()) = d.head(size());
  R_(size(), size()) = length;
  v[0] -= length;  // the vector of Householder's reflection of d2 to the next axis
  const Vector reflected = (z - length * J2.col(0)) * (2 / v.squaredNorm());  // of J2 v
  J2.noalias() -= reflected * v.transpose();
  bound_[size()] = bound(number);
  active_.push_back(number);
  ++exchanges_;
}

void DualActiveSet::drop(int j, Vector& d) {
  active_.erase(active_.begin() + j);
  for (int k = j; k < size(); ++k) {
    R_.col(k).head(k + 2) = R_.col(k + 1).head(k + 2);
    bound_[k] = bound_[k + 1];
    u_[k] = u_[k + 1];
  }
  u_.conservativeResize(size());
  for (int k = j; k < size(); ++k) {
    Eigen::JacobiRotation<double> rotation;
    rotation.makeGivens(R_(k, k), R_(k + 1, k));
    R_.middleCols(k, size() - k).applyOnTheLeft(k, k + 1, rotation.adjoint());
    J_.applyOnTheRight(k, k + 1, rotation);
    d.applyOnTheLeft(k, k + 1, rotation.adjoint());
  }
  ++exchanges_;
}

double DualActiveSet::slack(int number) const {
  if (number < rows_) return program_.rows.row(number).dot(x) - program_.least[number];
  const int i = number - rows_;
  return i < n_ ? x[i] - program_.lower[i] : program_.upper[i - n_] - x[i - n_];
}

double DualActiveSet::bound(int number) const {
  if (number < 0) return program_.equal[-1 - number];
  if (number < rows_) return program_.least[number];
  const int i = number - rows_;
  return i < n_ ? program_.lower[i] : -program_.upper[i - n_];
}

DualActiveSet::Vector DualActiveSet::across(int number) const {
  if (number < 0) return J_.transpose() * program_.equal_rows.row(-1 - number).transpose();
  if (number < rows_) return J_.transpose() * program_.rows.row(number).transpose();
  const int i = number - rows_;
  return (i < n_ ? 1.0 : -1.0) * J_.row(i % n_).transpose();
}

bool DualActiveSet::is_optimal() {
  of_equalities = u_.head(equalities());
  of_rows.setZero(rows_);
  of_bounds.setZero(n_);
  double off = (program_.equal_rows * x - program_.equal).lpNorm<Eigen::Infinity>();
  Vector gradient =
      program_.gradient + program_.hessian * x - program_.equal_rows.transpose() * of_equalities;
  Vector added = Vector::Zero(n_);
  for (int j = equalities(); j < size(); ++j) {
    const int number = active_[j], i = number - rows_;
    (i < 0 ? of_rows[number] : of_bounds[i % n_]) = i < n_ ? u_[j] : -u_[j];
    off = std::max(off, std::abs(slack(number)));
    if (i >= 0) continue;
    gradient -= u_[j] * program_.rows.row(number).transpose();
    added += u_[j] * program_.rows.row(number).cwiseAbs().transpose();
  }
  gradient -= of_bounds;
  // Rounding leaves a part of the largest number that is added up.
  const double largest = program_.gradient.lpNorm<Eigen::Infinity>() +
                         (program_.hessian.cwiseAbs() * x.cwiseAbs()).maxCoeff() + added.maxCoeff();
  return off <= tolerance_ && gradient.lpNorm<Eigen::Infinity>() <= tolerance_ * (1 + largest);
}

}  // namespace ff

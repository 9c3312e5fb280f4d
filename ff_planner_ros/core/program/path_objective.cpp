#include "program/path_objective.hpp"

namespace ff {

Terms PathObjective::terms(const Chain& chain, const PathMotion& motion,
                           const PathDerivatives& by_x, double step) const {
  const Eigen::Index variables = motion.variables();
  Terms found;
  found.gradient.setZero(variables);
  found.hessian.setZero(variables, variables);
  found.max_terms_jacobian.resize(0, variables);
  if (joint_path > 0) add_joint_path(motion, by_x, step, found);
  if (wheels && wheel_momentum > 0) {
    const WheelLoads loads(chain, *wheels, motion, by_x, step);
    const RowMajor by = wheel_momentum * loads.momenta_by_x;
    const RowMajor momenta = wheel_momentum * loads.momenta;
    add_largest({momenta.data(), momenta.size()}, {by.data(), momenta.size(), variables}, found);
  } else if (attitude > 0) {
    add_attitude(motion, by_x, found);
  }
  return found;
}

void PathObjective::add_joint_path(const PathMotion& motion, const PathDerivatives& by_x,
                                   double step, Terms& to) const {
  // In normalised time the path is as long, and does not depend on the duration.
  const double duration =
      motion.has_duration() ? step * static_cast<double>(motion.points() - 1) : 1;
  const auto add = [&](const Rows& v, const Rows& dv) {
    const JointPath path(v, dv, step / duration, slow * duration, smoothing);
    to.value += joint_path * path.value;
    to.gradient += joint_path * path.gradient;
    to.hessian += joint_path * path.hessian;
  };
  if (shares.size() == 0 && !motion.has_duration()) return add(view(motion.v), view(by_x.v));
  RowMajor v = motion.v, dv = by_x.v;
  if (motion.has_duration()) {
    dv *= duration;
    dv.rightCols<1>() += Eigen::Map<const Eigen::VectorXd>(v.data(), v.size());
    v *= duration;
  }
  if (shares.size() == 0) return add(view(v), view(dv));
  for (Eigen::Index i = 0; i < v.rows(); ++i) {
    v.row(i).array() *= shares.transpose().array();
    dv.middleRows(i * v.cols(), v.cols()).array().colwise() *= shares.array();
  }
  add(view(v), view(dv));
}

void PathObjective::add_attitude(const PathMotion& motion, const PathDerivatives& of_x,
                                 Terms& to) const {
  const ChaserEuler euler({motion.q.data(), motion.points(), motion.q.cols()},
                          {of_x.q.data(), of_x.v.rows(), motion.variables()}, chaser_to_base);
  const Values angles(euler.angles.data(), euler.angles.size());
  const Eigen::VectorXd values = attitude * angles;
  const RowMajor by_x = attitude * euler.jacobian;
  if (attitude_norm > 0) return add_power_mean(values, by_x, attitude_norm, to);
  add_largest(view(values), view(by_x), to);
}

void PathObjective::add_largest(const Values& values, const Rows& by_x, Terms& to) {
  const Eigen::Index count = values.size();
  to.max_terms.resize(2 * count);
  to.max_terms << values, -values;
  to.max_terms_jacobian.resize(2 * count, by_x.cols());
  to.max_terms_jacobian << by_x, -by_x;
}

void PathObjective::add_power_mean(const Eigen::VectorXd& values, const RowMajor& by_x, double p,
                                   Terms& to) {
  const double largest = values.lpNorm<Eigen::Infinity>();
  if (largest == 0) return;
  const auto count = static_cast<double>(values.size());
  const Eigen::ArrayXd parts = values.array() / largest;
  const double mean = std::pow(parts.abs().pow(p).sum() / count, 1 / p);
  const Eigen::ArrayXd shares = parts / mean;
  const Eigen::VectorXd slopes = shares.sign() * shares.abs().pow(p - 1) / count;
  const Eigen::VectorXd gradient = by_x.transpose() * slopes;
  const Eigen::ArrayXd curved = shares.abs().pow(p - 2) / count;
  const double value = largest * mean;
  const RowMajor squares = by_x.transpose() * curved.matrix().asDiagonal() * by_x;
  to.value += value;
  to.gradient += gradient;
  to.hessian += (p - 1) / value * (squares - gradient * gradient.transpose());
}

}  // namespace ff

#include "program/joint_splines.hpp"

namespace ff {

RowMajor SplineRows::values(const Eigen::VectorXd& x) const {
  const Rows of_joints(x.data(), known.cols(), free.cols());
  RowMajor found = known;
  found.noalias() += free * of_joints.transpose();
  return found;
}

RowMajor SplineRows::by_duration(const RowMajor& values, double order_by_duration) const {
  return moved - order_by_duration * values;
}

RowMajor SplineRows::by_x() const {
  const Eigen::Index joints = known.cols(), each = free.cols();
  const Eigen::Index variables = joints * each + has_duration();
  RowMajor found = RowMajor::Zero(known.rows(), joints * variables);
  for (Eigen::Index joint = 0; joint < joints; ++joint)
    found.middleCols(joint * (variables + each), each) = free;
  return found;
}

PathMotion JointSplinesOnGrid::motion(const Eigen::VectorXd& x, PathDerivatives& by_x) const {
  const RowMajor rates = grid_.rates.values(x), accelerations = grid_.accelerations.values(x);
  const DrivenMotion driven(chain_, start_, grid_.positions.values(x), rates, accelerations,
                            duration_);
  const std::vector<double> error = driven.goal_error(target_);
  const Eigen::Index points = driven.q.rows(), size = driven.v.cols();
  std::optional<Vector6> goal_by_duration;
  if (moved_) goal_by_duration = moved_->way;
  PathMotion found(x, points, size, goal_by_duration);
  const Eigen::Index variables = found.variables();
  by_x.resize(points, size, variables);
  found.q << driven.q, driven.q_half_way;
  found.v = driven.v;
  found.goal_error_by_x.resize(error.size(), variables);
  const RowMajor &of_positions = grid_.positions.free, &of_rates = grid_.rates.free,
                 &of_accelerations = grid_.accelerations.free;
  const Eigen::Index last = of_accelerations.rows() - 1;
  JointRows rows{{of_positions.data(), of_positions.rows(), of_positions.cols()},
                 {of_rates.data(), of_rates.rows(), of_rates.cols()},
                 {of_accelerations.row(last).data(), 1, of_accelerations.cols()},
                 chain_.joints()};
  if (moved_) {
    rows.angles_by_duration = grid_.positions.moved;
    rows.rates_by_duration = grid_.rates.by_duration(rates, 1 / duration_);
    rows.last_acceleration_by_duration =
        grid_.accelerations.by_duration(accelerations, 2 / duration_).bottomRows<1>();
  }
  driven.sensitivity(
      rows, target_, moved_.value_or(TargetChange()),
      {from_row(by_x.q, 0, points * size), from_row(by_x.v, 0, points * size),
       from_row(by_x.q, points * size, (points - 1) * size),
       from_row(found.goal_error_by_x, 0, error.size()), from_row(found.acceleration, 0, points)});
  if (has_goal_)
    found.goal_error = Values(error.data(), error.size());
  else
    found.goal_error_by_x.resize(0, variables);
  found.positions = hull(grid_.position_hull, position_hull_by_x_, x, 0);
  found.rates = hull(grid_.rate_hull, rate_hull_by_x_, x, 1 / duration_);
  return found;
}

JointHull JointSplinesOnGrid::hull(const SplineRows& rows,
                                   const std::shared_ptr<const RowMajor>& by_x,
                                   const Eigen::VectorXd& x, double order_by_duration) const {
  JointHull found{rows.values(x), by_x};
  if (!moved_) return found;
  const auto with_duration = std::make_shared<RowMajor>(*by_x);
  const RowMajor by_duration = rows.by_duration(found.points, order_by_duration);
  const Eigen::Index joints = by_duration.cols(), each = by_x->cols() / joints;
  for (Eigen::Index joint = 0; joint < joints; ++joint)
    with_duration->col((joint + 1) * each - 1) = by_duration.col(joint);
  return {found.points, with_duration};
}

}  // namespace ff

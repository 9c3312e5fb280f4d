// Joint splines on a time grid: the base follows by conservation of momentum.
#pragma once
#include "motion/driven_motion.hpp"
#include "program/path_motion.hpp"

namespace ff {

// Values of all joints that are linear in x: `known`, a column a joint, and each joint's own
// variables times `free`. As time derivatives of some order they are by the duration, too.
struct SplineRows {
  RowMajor free, known;
  RowMajor moved;  // how the ends' part changes with the duration; empty: the duration is given

  bool has_duration() const { return moved.size() > 0; }

  // x: the variables of a joint after those of another.
  RowMajor values(const Eigen::VectorXd& x) const {
    const Rows of_joints(x.data(), known.cols(), free.cols());
    RowMajor found = known;
    found.noalias() += free * of_joints.transpose();
    return found;
  }

  // Derivatives of `values` by the duration at fixed parts of it: the k-th derivative by time is
  // 1 / T^k of that by the part. order_by_duration: k / T.
  RowMajor by_duration(const RowMajor& values, double order_by_duration) const {
    return moved - order_by_duration * values;
  }

  // Derivatives of `values`, those of one joint after those of another; of the duration, zeros.
  RowMajor by_x() const {
    const Eigen::Index joints = known.cols(), each = free.cols();
    const Eigen::Index variables = joints * each + has_duration();
    RowMajor found = RowMajor::Zero(known.rows(), joints * variables);
    for (Eigen::Index joint = 0; joint < joints; ++joint)
      found.middleCols(joint * (variables + each), each) = free;
    return found;
  }
};

// Of joint splines, at half steps, and the hulls of positions and rates.
struct SplineGrid {
  SplineRows positions, rates, accelerations, position_hull, rate_hull;
};

class JointSplinesOnGrid : public PathsOnGrid {
 public:
  // has_goal: whether the goal is a condition, rather than fixed by the splines' ends. moved: how
  // the target changes with the duration, where that is one more variable.
  JointSplinesOnGrid(const Chain& chain, const Start& start, const Target& target, bool has_goal,
                     double duration, SplineGrid grid, const std::optional<TargetChange>& moved)
      : chain_(chain),
        start_(start),
        target_(target),
        has_goal_(has_goal),
        duration_(duration),
        grid_(std::move(grid)),
        moved_(moved),
        position_hull_by_x_(std::make_shared<RowMajor>(grid_.position_hull.by_x())),
        rate_hull_by_x_(std::make_shared<RowMajor>(grid_.rate_hull.by_x())) {}

  const Chain& chain() const override { return chain_; }
  Eigen::Index points() const override { return (grid_.positions.known.rows() + 1) / 2; }
  Eigen::Index variables() const override { return chain_.joints() * grid_.positions.free.cols(); }

  PathMotion motion(const Eigen::VectorXd& x, PathDerivatives& by_x) const override {
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
    driven.sensitivity(rows, target_, moved_.value_or(TargetChange()),
                       {from_row(by_x.q, 0, points * size), from_row(by_x.v, 0, points * size),
                        from_row(by_x.q, points * size, (points - 1) * size),
                        from_row(found.goal_error_by_x, 0, error.size()),
                        from_row(found.acceleration, 0, points)});
    if (has_goal_)
      found.goal_error = Values(error.data(), error.size());
    else
      found.goal_error_by_x.resize(0, variables);
    found.positions = hull(grid_.position_hull, position_hull_by_x_, x, 0);
    found.rates = hull(grid_.rate_hull, rate_hull_by_x_, x, 1 / duration_);
    return found;
  }

 private:
  JointHull hull(const SplineRows& rows, const std::shared_ptr<const RowMajor>& by_x,
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

  Chain chain_;
  Start start_;
  Target target_;
  bool has_goal_;
  double duration_;
  SplineGrid grid_;
  std::optional<TargetChange> moved_;
  std::shared_ptr<const RowMajor> position_hull_by_x_, rate_hull_by_x_;
};

}  // namespace ff

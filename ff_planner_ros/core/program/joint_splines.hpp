// Joint splines on a time grid: the base follows by conservation of momentum.
#pragma once
#include "motion/driven_motion.hpp"
#include "program/path_motion.hpp"

namespace ff {

// Values of all joints that are linear in x: `known`, a column a joint, and each joint's own
// variables times `free`.
struct SplineRows {
  RowMajor free, known;

  // x: the variables of a joint after those of another.
  RowMajor values(const Eigen::VectorXd& x) const {
    const Rows of_joints(x.data(), known.cols(), free.cols());
    RowMajor found = known;
    found.noalias() += free * of_joints.transpose();
    return found;
  }

  // Derivatives of `values`, those of one joint after those of another.
  RowMajor by_x() const {
    const Eigen::Index joints = known.cols(), each = free.cols();
    RowMajor found = RowMajor::Zero(known.rows(), joints * joints * each);
    for (Eigen::Index joint = 0; joint < joints; ++joint)
      found.middleCols((joint * joints + joint) * each, each) = free;
    return found;
  }
};

// Of joint splines, at half steps, and the hulls of positions and rates.
struct SplineGrid {
  SplineRows positions, rates, accelerations, position_hull, rate_hull;
};

class JointSplinesOnGrid : public PathsOnGrid {
 public:
  // has_goal: whether the goal is a condition, rather than fixed by the splines' ends.
  JointSplinesOnGrid(const Chain& chain, const Start& start, const Target& target, bool has_goal,
                     double duration, SplineGrid grid)
      : chain_(chain),
        start_(start),
        target_(target),
        has_goal_(has_goal),
        duration_(duration),
        grid_(std::move(grid)),
        position_hull_by_x_(std::make_shared<RowMajor>(grid_.position_hull.by_x())),
        rate_hull_by_x_(std::make_shared<RowMajor>(grid_.rate_hull.by_x())) {}

  const Chain& chain() const override { return chain_; }
  Eigen::Index points() const override { return (grid_.positions.known.rows() + 1) / 2; }
  Eigen::Index variables() const override { return chain_.joints() * grid_.positions.free.cols(); }

  PathMotion motion(const Eigen::VectorXd& x, PathDerivatives& by_x) const override {
    const DrivenMotion driven(chain_, start_, grid_.positions.values(x), grid_.rates.values(x),
                              grid_.accelerations.values(x), duration_);
    const std::vector<double> error = driven.goal_error(target_);
    const Eigen::Index points = driven.q.rows(), size = driven.v.cols(), variables = x.size();
    PathMotion found(x, points, size);
    by_x.resize(points, size, variables);
    found.q << driven.q, driven.q_half_way;
    found.v = driven.v;
    found.goal_error_by_x.resize(error.size(), variables);
    const RowMajor &of_positions = grid_.positions.free, &of_rates = grid_.rates.free,
                   &of_accelerations = grid_.accelerations.free;
    const Eigen::Index last = of_accelerations.rows() - 1;
    const JointRows rows{{of_positions.data(), of_positions.rows(), of_positions.cols()},
                         {of_rates.data(), of_rates.rows(), of_rates.cols()},
                         {of_accelerations.row(last).data(), 1, of_accelerations.cols()},
                         chain_.joints()};
    driven.sensitivity(rows, target_, TargetChange(),
                       {from_row(by_x.q, 0, points * size), from_row(by_x.v, 0, points * size),
                        from_row(by_x.q, points * size, (points - 1) * size),
                        from_row(found.goal_error_by_x, 0, error.size()),
                        from_row(found.acceleration, 0, points)});
    if (has_goal_)
      found.goal_error = Values(error.data(), error.size());
    else
      found.goal_error_by_x.resize(0, variables);
    found.positions = {grid_.position_hull.values(x), position_hull_by_x_};
    found.rates = {grid_.rate_hull.values(x), rate_hull_by_x_};
    return found;
  }

 private:
  Chain chain_;
  Start start_;
  Target target_;
  bool has_goal_;
  double duration_;
  SplineGrid grid_;
  std::shared_ptr<const RowMajor> position_hull_by_x_, rate_hull_by_x_;
};

}  // namespace ff

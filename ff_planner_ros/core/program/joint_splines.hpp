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
  RowMajor values(const Eigen::VectorXd& x) const;

  // Derivatives of `values` by the duration at fixed parts of it: the k-th derivative by time is
  // 1 / T^k of that by the part. order_by_duration: k / T.
  RowMajor by_duration(const RowMajor& values, double order_by_duration) const;

  // Derivatives of `values`, those of one joint after those of another; of the duration, zeros.
  RowMajor by_x() const;
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

  PathMotion motion(const Eigen::VectorXd& x, PathDerivatives& by_x) const override;

 private:
  JointHull hull(const SplineRows& rows, const std::shared_ptr<const RowMajor>& by_x,
                 const Eigen::VectorXd& x, double order_by_duration) const;

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

// A path's motion at each point of a time grid, with its derivatives by the path's variables, and
// the motions of both families of paths.
#pragma once
#include <memory>

#include "motion/driven_motion.hpp"
#include "motion/end_effector_rollout.hpp"

namespace ff {

// Points whose range bounds each joint at all times, and their derivatives: a row a point, those of
// one joint after those of another. Empty: not known.
struct JointHull {
  RowMajor points;
  std::shared_ptr<const RowMajor> by_x;
};

struct PathMotion {
  Eigen::VectorXd x;
  RowMajor q;                // at the points, then half-way between two; a row each
  RowMajor v, acceleration;  // at the points
  // In the conditions of the goal that the family does not fix; a row of derivatives each.
  Eigen::VectorXd goal_error;
  RowMajor goal_error_by_x;
  JointHull positions, rates;
  double singular_at = std::numeric_limits<double>::quiet_NaN();  // [s]; NaN: the motion is regular

  PathMotion(const Eigen::VectorXd& x, Eigen::Index points, Eigen::Index size)
      : x(x),
        q(2 * points - 1, 1 + size),
        v(points, size),
        acceleration(points, size),
        goal_error_by_x(0, x.size()) {}

  bool is_regular() const { return std::isnan(singular_at); }
  Eigen::Index points() const { return v.rows(); }
  Eigen::Index variables() const { return x.size(); }
};

// Of q and v of a motion in the tangent space: a block of rows each, and a column a variable.
struct PathDerivatives {
  RowMajor q, v;

  void resize(Eigen::Index points, Eigen::Index size, Eigen::Index variables) {
    q.resize((2 * points - 1) * size, variables);
    v.resize(points * size, variables);
  }
};

// Rows of a matrix that a motion is written to.
inline RowsToFill from_row(RowMajor& of, Eigen::Index first, Eigen::Index count) {
  return {of.data() + first * of.cols(), count, of.cols()};
}

// The paths of one family on one time grid.
class PathsOnGrid {
 public:
  virtual ~PathsOnGrid() = default;
  virtual PathMotion motion(const Eigen::VectorXd& x, PathDerivatives& by_x) const = 0;
  virtual const Chain& chain() const = 0;
  virtual Eigen::Index points() const = 0;
  virtual Eigen::Index variables() const = 0;
};

class EndEffectorPathsOnGrid : public PathsOnGrid {
 public:
  EndEffectorPathsOnGrid(const Chain& chain, const Configuration& start, const Vector6& momentum,
                         const EndEffectorPolynomial& path, const NullSpaceFade& null_space,
                         int points, double damping)
      : chain_(chain),
        start_(start),
        momentum_(momentum),
        path_(path),
        null_space_(null_space),
        points_(points),
        damping_(damping) {}

  const Chain& chain() const override { return chain_; }
  Eigen::Index points() const override { return points_; }
  Eigen::Index variables() const override { return kParameters; }

  PathMotion motion(const Eigen::VectorXd& x, PathDerivatives& by_x) const override {
    const Eigen::Index size = 6 + chain_.joints(), points = points_, gaps = points - 1;
    PathMotion found(x, points, size);
    by_x.resize(points, size, kParameters);
    const EndEffectorRollout<kParameters> rollout(chain_, momentum_, path_, null_space_,
                                                  Eigen::Map<const Coefficients>(x.data()), points_,
                                                  damping_);
    const int singular = rollout.run(
        start_, {from_row(found.q, 0, points), from_row(found.v, 0, points),
                 from_row(found.q, points, gaps), from_row(by_x.q, 0, points * size),
                 from_row(by_x.v, 0, points * size), from_row(by_x.q, points * size, gaps * size),
                 from_row(found.acceleration, 0, points)});
    if (singular != kRegular)
      found.singular_at = singular / (2.0 * static_cast<double>(gaps)) * path_.duration;
    return found;
  }

 private:
  Chain chain_;
  Configuration start_;
  Vector6 momentum_;
  EndEffectorPolynomial path_;
  NullSpaceFade null_space_;
  int points_;
  double damping_;
};

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

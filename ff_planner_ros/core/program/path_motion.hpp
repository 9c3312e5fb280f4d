// A path's motion at each point of a time grid, with its derivatives by the path's variables.
#pragma once
#include <cmath>
#include <limits>
#include <memory>
#include <optional>

#include "optimisation/limit_rows.hpp"

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
  // How the goal's pose changes with the duration, where that is the last variable; inertial axes.
  std::optional<Vector6> goal_by_duration;
  double singular_at = std::numeric_limits<double>::quiet_NaN();  // [s]; NaN: the motion is regular

  PathMotion(const Eigen::VectorXd& x, Eigen::Index points, Eigen::Index size,
             const std::optional<Vector6>& goal_by_duration)
      : x(x),
        q(2 * points - 1, 1 + size),
        v(points, size),
        acceleration(points, size),
        goal_error_by_x(0, x.size() + goal_by_duration.has_value()),
        goal_by_duration(goal_by_duration) {}

  bool has_duration() const { return goal_by_duration.has_value(); }
  bool is_regular() const { return std::isnan(singular_at); }
  Eigen::Index points() const { return v.rows(); }
  Eigen::Index variables() const { return goal_error_by_x.cols(); }
};

// Of q and v of a motion in the tangent space: a block of rows each, and a column a variable.
struct PathDerivatives {
  RowMajor q, v;

  void resize(Eigen::Index points, Eigen::Index size, Eigen::Index variables);
};

// The joints of a motion from a point on.
JointsAtPoints joints_of(const PathMotion& motion, const PathDerivatives& by_x,
                         Eigen::Index first = 0);

// Rows of a matrix that a motion is written to.
RowsToFill from_row(RowMajor& of, Eigen::Index first, Eigen::Index count);

// The paths of one family on one time grid.
class PathsOnGrid {
 public:
  virtual ~PathsOnGrid() = default;
  virtual PathMotion motion(const Eigen::VectorXd& x, PathDerivatives& by_x) const = 0;
  virtual const Chain& chain() const = 0;
  virtual Eigen::Index points() const = 0;
  virtual Eigen::Index variables() const = 0;
};

}  // namespace ff

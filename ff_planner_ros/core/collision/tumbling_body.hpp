// A body that nothing acts on.
#pragma once
#include <vector>

#include "kinematics/chain.hpp"

namespace ff {

// Its quaternion (x, y, z, w) by Taylor series, one after the other.
struct TumblingBody {
  using Series = Eigen::Matrix<double, Eigen::Dynamic, 4, Eigen::RowMajor>;  // a row an order

  Vector3 position, velocity;  // of its centre of mass; the position when the plan begins
  std::vector<double> begins;  // of each series [s]
  std::vector<Series> series;

  // Where its centre of mass is, and its axes to inertial axes.
  Pose pose(double time) const;

  // Of a point in the body's axes, from its centre of mass [m/s].
  Vector3 speed(const Vector3& point, double time) const;

  // A rate that its turn does not exceed until a time [rad/s].
  double fastest_turn(double until) const;

 private:
  std::ptrdiff_t series_at(double time) const;
};

}  // namespace ff

// Spheres that rest, move uniformly, or are fixed to a body that turns freely.
#pragma once
#include <algorithm>
#include <memory>
#include <vector>

#include "kinematics/chain.hpp"

namespace ff {

// A body that nothing acts on: its quaternion (x, y, z, w) by Taylor series, one after the other.
struct TumblingBody {
  using Series = Eigen::Matrix<double, Eigen::Dynamic, 4, Eigen::RowMajor>;  // a row an order

  Vector3 position, velocity;  // of its centre of mass; the position when the plan begins
  std::vector<double> begins;  // of each series [s]
  std::vector<Series> series;

  // Where its centre of mass is, and its axes to inertial axes.
  Pose pose(double time) const;

  // Of a point in the body's axes, from its centre of mass.
  Vector3 place(const Vector3& point, double time) const;

  // Of that point [m/s]: the same with the quaternion's derivative, whose length stays what it is.
  Vector3 speed(const Vector3& point, double time) const;

 private:
  std::ptrdiff_t series_at(double time) const;
};

struct Sphere {
  Vector3 center, velocity;  // when the plan begins; from then on, unless it is fixed to a body
  double radius;
  double highest_speed;                      // that its centre never exceeds [m/s]
  std::shared_ptr<const TumblingBody> body;  // none: it moves uniformly
  Vector3 place;                             // in that body

  Vector3 center_at(double time) const;
  Vector3 velocity_at(double time) const { return body ? body->speed(place, time) : velocity; }

  // The box around its centre at all of some times.
  Eigen::AlignedBox3d way(const Values& times) const;
};

}  // namespace ff

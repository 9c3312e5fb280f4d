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
  Pose pose(double time) const {
    const auto number = series_at(time);
    const Series& terms = series[number];
    Eigen::Matrix<double, 1, 4> q = terms.row(terms.rows() - 1);
    for (auto k = terms.rows() - 2; k >= 0; --k) q = q * (time - begins[number]) + terms.row(k);
    const Eigen::Quaterniond attitude(q[3], q[0], q[1], q[2]);
    return {position + time * velocity, attitude.normalized().toRotationMatrix()};
  }

  // Of a point in the body's axes, from its centre of mass.
  Vector3 place(const Vector3& point, double time) const {
    const auto number = series_at(time);
    const Series& terms = series[number];
    Eigen::Matrix<double, 1, 4> q = terms.row(terms.rows() - 1);
    for (auto k = terms.rows() - 2; k >= 0; --k) q = q * (time - begins[number]) + terms.row(k);
    const Vector3 axis = q.head<3>().transpose();
    const Vector3 across = axis.cross(point);
    return position + time * velocity + point +
           2 / q.squaredNorm() * (q[3] * across + axis.cross(across));
  }

  // Of that point [m/s]: the same with the quaternion's derivative, whose length stays what it is.
  Vector3 speed(const Vector3& point, double time) const {
    const auto number = series_at(time);
    const Series& terms = series[number];
    const double after = time - begins[number];
    Eigen::Matrix<double, 1, 4> q = terms.row(terms.rows() - 1), rate = q * 0;
    for (auto k = terms.rows() - 2; k >= 0; --k) {
      rate = rate * after + q;
      q = q * after + terms.row(k);
    }
    const Vector3 axis = q.head<3>().transpose(), by = rate.head<3>().transpose();
    const Vector3 across = axis.cross(point), across_by = by.cross(point);
    return velocity +
           2 / q.squaredNorm() *
               (rate[3] * across + q[3] * across_by + by.cross(across) + axis.cross(across_by));
  }

 private:
  std::ptrdiff_t series_at(double time) const {
    return std::upper_bound(begins.begin() + 1, begins.end(), time) - begins.begin() - 1;
  }
};

struct Sphere {
  Vector3 center, velocity;  // when the plan begins; from then on, unless it is fixed to a body
  double radius;
  double highest_speed;                      // that its centre never exceeds [m/s]
  std::shared_ptr<const TumblingBody> body;  // none: it moves uniformly
  Vector3 place;                             // in that body

  Vector3 center_at(double time) const {
    return body ? body->place(place, time) : center + time * velocity;
  }
  Vector3 velocity_at(double time) const { return body ? body->speed(place, time) : velocity; }

  // The box around its centre at all of some times.
  Eigen::AlignedBox3d way(const Values& times) const {
    const Vector3 begin = center_at(times.minCoeff()), end = center_at(times.maxCoeff());
    Eigen::AlignedBox3d box(begin.cwiseMin(end), begin.cwiseMax(end));
    if (body)  // it may have swung by meanwhile
      for (const double time : times) box.extend(center_at(time));
    return box;
  }
};

}  // namespace ff

// Spatial vectors as Pinocchio orders them: the linear part first. Angular velocity and force act
// at the origin of the frame that they are expressed in [Featherstone, Rigid Body Dynamics
// Algorithms, 2008].
#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cmath>

namespace ff {

using Vector3 = Eigen::Vector3d;
using Matrix3 = Eigen::Matrix3d;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

inline Matrix3 skew(const Vector3& a) {
  return (Matrix3() << 0, -a.z(), a.y(), a.z(), 0, -a.x(), -a.y(), a.x(), 0).finished();
}

// skew(a) skew(a), without what is zero.
inline Matrix3 skew_square(const Vector3& a) {
  Matrix3 square = a * a.transpose();
  square.diagonal() << -(a.y() * a.y() + a.z() * a.z()), -(a.x() * a.x() + a.z() * a.z()),
      -(a.x() * a.x() + a.y() * a.y());
  return square;
}

inline Vector6 stack(const Vector3& linear, const Vector3& angular) {
  Vector6 both;
  both.head<3>() = linear;
  both.tail<3>() = angular;
  return both;
}

// How a motion changes that is carried along by the motion `by`: by x motion.
inline Vector6 cross_motion(const Vector6& by, const Vector6& motion) {
  const Vector3 v = by.head<3>(), w = by.tail<3>();
  const Vector3 linear = motion.head<3>(), angular = motion.tail<3>();
  return stack(w.cross(linear) + v.cross(angular), w.cross(angular));
}

// The same for a force: by x* force.
inline Vector6 cross_force(const Vector6& by, const Vector6& force) {
  const Vector3 v = by.head<3>(), w = by.tail<3>();
  const Vector3 linear = force.head<3>(), torque = force.tail<3>();
  return stack(w.cross(linear), w.cross(torque) + v.cross(linear));
}

// The matrix of `cross_motion` with `by`.
Matrix6 cross_motion_matrix(const Vector6& by);

// Inertia of one body or of several: mass, first and second moments about the origin.
struct Inertia {
  double mass;
  Vector3 first;
  Matrix3 second;

  static Inertia of_body(double mass, const Vector3& center, const Matrix3& about_center) {
    return {mass, mass * center, about_center - mass * skew_square(center)};
  }
  Inertia operator+(const Inertia& other) const {
    return {mass + other.mass, first + other.first, second + other.second};
  }
  void operator+=(const Inertia& other) { *this = *this + other; }
  // Momentum of a motion.
  Vector6 operator*(const Vector6& motion) const {
    const Vector3 v = motion.head<3>(), w = motion.tail<3>();
    return stack(mass * v + w.cross(first), first.cross(v) + second * w);
  }
  // The same as a matrix.
  Matrix6 matrix() const;
  // The matrix that gives the motion of a momentum: with c the centre of mass and A the inverse of
  // the inertia about it, w = A (torque - c x force) and v = force / mass + c x w.
  Matrix6 inverse() const;
};

// Where a frame is in an outer one.
struct Pose {
  Vector3 position;
  Matrix3 rotation;  // to the outer frame

  Pose operator*(const Pose& inner) const {
    return {position + rotation * inner.position, rotation * inner.rotation};
  }
  Vector3 operator*(const Vector3& point) const { return position + rotation * point; }
  Pose inverse() const { return {-(rotation.transpose() * position), rotation.transpose()}; }
  // X: turns motions of the outer frame into those of the inner one.
  Matrix6 motion_to_inner() const;
};

// Rotation by an angle about an axis of unit length [Rodrigues].
Matrix3 rotation_about(const Vector3& axis, double angle);

}  // namespace ff

// Turns in three dimensions: exp and log on SO(3) with their derivatives, and quaternions.
#pragma once
#include "kinematics/rigid_motion.hpp"

namespace ff {

// exp: where a frame gets that turns by `w` in its own axes.
Matrix3 turned_by(const Vector3& w);

// Its derivative, in the axes of the frame where it got to.
Matrix3 turned_by_derivative(const Vector3& w);

// Quaternion xyzw of a rotation: of both the one whose largest entry is positive, as SciPy's.
Eigen::Vector4d quaternion_xyzw(const Matrix3& R);

// The turn of half a revolution or less that leads to a rotation.
Vector3 turn_of_quaternion(const Eigen::Vector4d& q);
inline Vector3 turn_of(const Matrix3& R) { return turn_of_quaternion(quaternion_xyzw(R)); }

// Its derivative by a turn of the frame in its own axes: the inverse of `turned_by_derivative`.
Matrix3 turn_of_derivative(const Vector3& w);

}  // namespace ff

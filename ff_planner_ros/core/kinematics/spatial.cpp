#include "kinematics/spatial.hpp"

#include <Eigen/LU>

namespace ff {

Matrix6 cross_motion_matrix(const Vector6& by) {
  Matrix6 matrix = Matrix6::Zero();
  matrix.topLeftCorner<3, 3>() = matrix.bottomRightCorner<3, 3>() = skew(by.tail<3>());
  matrix.topRightCorner<3, 3>() = skew(by.head<3>());
  return matrix;
}

Matrix6 Inertia::matrix() const {
  Matrix6 all;
  all.topLeftCorner<3, 3>() = mass * Matrix3::Identity();
  all.bottomLeftCorner<3, 3>() = skew(first);
  all.topRightCorner<3, 3>() = -skew(first);
  all.bottomRightCorner<3, 3>() = second;
  return all;
}

Matrix6 Inertia::inverse() const {
  const Matrix3 C = skew(first / mass), A = Matrix3(second + mass * C * C).inverse();
  Matrix6 all;
  all.topLeftCorner<3, 3>() = Matrix3::Identity() / mass - C * A * C;
  all.topRightCorner<3, 3>() = C * A;
  all.bottomLeftCorner<3, 3>() = -A * C;
  all.bottomRightCorner<3, 3>() = A;
  return all;
}

Matrix6 Pose::motion_to_inner() const {
  Matrix6 action = Matrix6::Zero();
  const Matrix3 to_inner = rotation.transpose();
  action.topLeftCorner<3, 3>() = action.bottomRightCorner<3, 3>() = to_inner;
  action.topRightCorner<3, 3>() = -to_inner * skew(position);
  return action;
}

Matrix3 rotation_about(const Vector3& axis, double angle) {
  return Matrix3::Identity() + std::sin(angle) * skew(axis) +
         (1 - std::cos(angle)) * skew_square(axis);
}

}  // namespace ff

#include "kinematics/rotation.hpp"

namespace ff {

Matrix3 turned_by(const Vector3& w) {
  const AngleFunctions of(w.squaredNorm());
  return Matrix3::Identity() + (1 - of.c * w.squaredNorm()) * skew(w) + of.b * skew_square(w);
}

Matrix3 turned_by_derivative(const Vector3& w) {
  const AngleFunctions of(w.squaredNorm());
  return Matrix3::Identity() - of.b * skew(w) + of.c * skew_square(w);
}

Eigen::Vector4d quaternion_xyzw(const Matrix3& R) {
  const Eigen::Vector4d candidates(R(0, 0), R(1, 1), R(2, 2), R.trace());
  int largest;
  candidates.maxCoeff(&largest);
  Eigen::Vector4d q;
  if (largest == 3) {
    q << R(2, 1) - R(1, 2), R(0, 2) - R(2, 0), R(1, 0) - R(0, 1), 1 + R.trace();
  } else {
    const int i = largest, j = (i + 1) % 3, k = (i + 2) % 3;
    q[i] = 1 - R.trace() + 2 * R(i, i);
    q[j] = R(j, i) + R(i, j);
    q[k] = R(k, i) + R(i, k);
    q[3] = R(k, j) - R(j, k);
  }
  return q.normalized();
}

Vector3 turn_of_quaternion(const Eigen::Vector4d& q) {
  const Vector3 axis = q[3] < 0 ? Vector3(-q.head<3>()) : Vector3(q.head<3>());
  const double sine = axis.norm(), cosine = std::abs(q[3]);  // of half the angle
  return (sine > 1e-8 ? 2 * std::atan2(sine, cosine) / sine : 2.) * axis;
}

Matrix3 turn_of_derivative(const Vector3& w) {
  const double y = w.squaredNorm(), half = std::sqrt(y) / 2;
  const Matrix3 W = skew(w);
  const double of_square = y < 1e-6 ? 1. / 12 + y / 720 : (1 - half / std::tan(half)) / y;
  return Matrix3::Identity() + W / 2 + of_square * W * W;
}

}  // namespace ff

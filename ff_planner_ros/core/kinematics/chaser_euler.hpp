// The chaser's Euler angles, of which the largest is J_Theta, Eq. (45), and their derivatives.
#pragma once
#include "kinematics/chain.hpp"

namespace ff {

// The angles phi, theta, psi of R = Rz(psi) Ry(theta) Rx(phi).
inline Vector3 euler_angles(const Matrix3& R) {
  return {std::atan2(R(2, 1), R(2, 2)), std::atan2(-R(2, 0), std::hypot(R(2, 1), R(2, 2))),
          std::atan2(R(1, 0), R(0, 0))};
}

// Their rates by the angular velocity in the axes from which they count: the inverse of
// `euler_rate_map`.
inline Matrix3 euler_rates(const Vector3& euler) {
  const double sy = std::sin(euler.y()), cy = std::cos(euler.y());
  const double sz = std::sin(euler.z()), cz = std::cos(euler.z());
  return (Matrix3() << cz / cy, sz / cy, 0, -sz, cz, 0, cz * sy / cy, sz * sy / cy, 1).finished();
}

struct ChaserEuler {
  RowMajor angles;    // shape (points, 3)
  RowMajor jacobian;  // three rows a point

  // q: configurations, a row a point; dq: their derivatives, a block of rows a point.
  ChaserEuler(const Rows& q, const Rows& dq, const Matrix3& chaser_to_base)
      : angles(q.rows(), 3), jacobian(3 * q.rows(), dq.cols()) {
    const Eigen::Index size = q.cols() - 1;
    for (int i = 0; i < q.rows(); ++i) {
      const Matrix3 R = Configuration::read(q.row(i)).attitude.toRotationMatrix();
      const Vector3 euler = euler_angles(R * chaser_to_base);
      angles.row(i) = euler.transpose();
      jacobian.middleRows<3>(3 * i) = euler_rates(euler) * R * dq.middleRows(size * i + 3, 3);
    }
  }
};

}  // namespace ff

#include "kinematics/chaser_euler.hpp"

namespace ff {

Vector3 euler_angles(const Matrix3& R) {
  return {std::atan2(R(2, 1), R(2, 2)), std::atan2(-R(2, 0), std::hypot(R(2, 1), R(2, 2))),
          std::atan2(R(1, 0), R(0, 0))};
}

Matrix3 euler_rates(const Vector3& euler) {
  const double sy = std::sin(euler.y()), cy = std::cos(euler.y());
  const double sz = std::sin(euler.z()), cz = std::cos(euler.z());
  return (Matrix3() << cz / cy, sz / cy, 0, -sz, cz, 0, cz * sy / cy, sz * sy / cy, 1).finished();
}

ChaserEuler::ChaserEuler(const Rows& q, const Rows& dq, const Matrix3& chaser_to_base)
    : angles(q.rows(), 3), jacobian(3 * q.rows(), dq.cols()) {
  const Eigen::Index size = q.cols() - 1;
  for (int i = 0; i < q.rows(); ++i) {
    const Matrix3 R = Configuration::read(q.row(i)).attitude.toRotationMatrix();
    const Vector3 euler = euler_angles(R * chaser_to_base);
    angles.row(i) = euler.transpose();
    jacobian.middleRows<3>(3 * i) = euler_rates(euler) * R * dq.middleRows(size * i + 3, 3);
  }
}

}  // namespace ff

// The chaser's Euler angles, of which the largest is J_Theta, Eq. (45), and their derivatives.
#pragma once
#include "kinematics/chain.hpp"

namespace ff {

// The angles phi, theta, psi of R = Rz(psi) Ry(theta) Rx(phi).
Vector3 euler_angles(const Matrix3& R);

// Their rates by the angular velocity in the axes from which they count: the inverse of
// `euler_rate_map`.
Matrix3 euler_rates(const Vector3& euler);

struct ChaserEuler {
  RowMajor angles;    // shape (points, 3)
  RowMajor jacobian;  // three rows a point

  // q: configurations, a row a point; dq: their derivatives, a block of rows a point.
  ChaserEuler(const Rows& q, const Rows& dq, const Matrix3& chaser_to_base);
};

}  // namespace ff

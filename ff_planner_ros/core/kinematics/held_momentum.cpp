#include "kinematics/held_momentum.hpp"

namespace ff {

HeldMomentum::HeldMomentum(const Posture& posture, const Joints& rates,
                           const Joints& accelerations) {
  const int n = static_cast<int>(rates.size());
  std::vector<Vector6> V(n + 1, Vector6::Zero()), a = V;  // of the bodies
  for (int k = 0; k < n; ++k) {
    const Vector6 S = posture.screws.col(k);
    V[k + 1] = V[k] + S * rates[k];
    a[k + 1] = a[k] + S * accelerations[k] + cross_motion(V[k], S) * rates[k];
  }
  // Momentum, its rate, and the rate of the inertia of a body and of all that it carries.
  Vector6 H = Vector6::Zero(), F = Vector6::Zero();
  Matrix6 rate = Matrix6::Zero();
  Matrix6J h_by_joints(6, n), h_by_rates(6, n), f_by_joints(6, n), f_by_rates(6, n);
  for (int k = n - 1; k >= 0; --k) {
    const Vector6 S = posture.screws.col(k);
    const Vector6& v = V[k + 1];
    const Inertia &body = posture.body[k + 1], &beyond = posture.composite[k + 1];
    const Matrix6 turning = cross_motion_matrix(v), inertia = body.matrix();
    H += body * v;
    F += body * a[k + 1] + cross_force(v, body * v);
    rate -= turning.transpose() * inertia + inertia * turning;
    // All that is beyond a joint turns with it, but for what the joint itself moves at.
    const Vector6 u = cross_motion(S, v);
    h_by_rates.col(k) = beyond * S;
    h_by_joints.col(k) = cross_force(S, H) - beyond * u;
    f_by_rates.col(k) = rate * S + cross_force(S, H) - 2 * (beyond * u);
    f_by_joints.col(k) = cross_force(S, F) -
                         beyond * (cross_motion(S, a[k + 1]) - cross_motion(u, v)) -
                         cross_force(u, H) - rate * u;
  }
  // From the base's origin to the centre of mass c: L - c x P, and c moves by P / m.
  const Inertia& all = posture.composite[0];
  const Vector3 c = all.first / all.mass;
  const Matrix3J of_center = h_by_rates.topRows<3>() / all.mass;
  const auto about = [&](const Vector6& of) -> Vector3 {
    return of.tail<3>() - c.cross(of.head<3>());
  };
  momentum = about(H);
  torque = about(F);
  momentum_by_rates.resize(3, n);
  momentum_by_joints = torque_by_joints = torque_by_rates = momentum_by_rates;
  for (int k = 0; k < n; ++k) {
    const Vector3 moved = of_center.col(k);
    momentum_by_rates.col(k) = about(h_by_rates.col(k));
    momentum_by_joints.col(k) = about(h_by_joints.col(k)) - moved.cross(H.head<3>());
    torque_by_rates.col(k) = about(f_by_rates.col(k));
    torque_by_joints.col(k) = about(f_by_joints.col(k)) - moved.cross(F.head<3>());
  }
}

}  // namespace ff

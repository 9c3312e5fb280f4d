#include "kinematics/held_momentum.hpp"

namespace ff {

HeldMomentum::HeldMomentum(const Posture& posture, const Joints& rates,
                           const Joints& accelerations) {
  const Tree& tree = *posture.tree;
  const int n = tree.joints();
  const Joints each_rate = tree.rates(rates), each_acceleration = tree.rates(accelerations);
  std::vector<Vector6> V(n + 1, Vector6::Zero()), a = V;  // of the bodies
  for (int k = 0; k < n; ++k) {
    const int before = tree.before[k];
    const Vector6 S = posture.screws.col(k);
    V[k + 1] = V[before] + S * each_rate[k];
    a[k + 1] = a[before] + S * each_acceleration[k] + cross_motion(V[before], S) * each_rate[k];
  }
  // Momentum, its rate, and the rate of the inertia of a body and of all that it carries.
  std::vector<Vector6> H(n + 1, Vector6::Zero()), F = H;
  std::vector<Matrix6> rate(n + 1, Matrix6::Zero());
  Matrix6J h_by_joints(6, n), h_by_rates(6, n), f_by_joints(6, n), f_by_rates(6, n);
  for (int k = n - 1; k >= 0; --k) {
    const Vector6 S = posture.screws.col(k);
    const Vector6& v = V[k + 1];
    const Inertia &body = posture.body[k + 1], &beyond = posture.composite[k + 1];
    const Matrix6 turning = cross_motion_matrix(v), inertia = body.matrix();
    H[k + 1] += body * v;
    F[k + 1] += body * a[k + 1] + cross_force(v, body * v);
    rate[k + 1] -= turning.transpose() * inertia + inertia * turning;
    // All that is beyond a joint turns with it, but for what the joint itself moves at.
    const Vector6 u = cross_motion(S, v);
    h_by_rates.col(k) = beyond * S;
    h_by_joints.col(k) = cross_force(S, H[k + 1]) - beyond * u;
    f_by_rates.col(k) = rate[k + 1] * S + cross_force(S, H[k + 1]) - 2 * (beyond * u);
    f_by_joints.col(k) = cross_force(S, F[k + 1]) -
                         beyond * (cross_motion(S, a[k + 1]) - cross_motion(u, v)) -
                         cross_force(u, H[k + 1]) - rate[k + 1] * u;
    const int before = tree.before[k];
    H[before] += H[k + 1];
    F[before] += F[k + 1];
    rate[before] += rate[k + 1];
  }
  for (Matrix6J* by : {&h_by_joints, &h_by_rates, &f_by_joints, &f_by_rates})
    *by = tree.by_planned(*by);
  // From the base's origin to the centre of mass c: L - c x P, and c moves by P / m.
  const Inertia& all = posture.composite[0];
  const Vector3 c = all.first / all.mass;
  const Matrix3J of_center = h_by_rates.topRows<3>() / all.mass;
  const auto about = [&](const Vector6& of) -> Vector3 {
    return of.tail<3>() - c.cross(of.head<3>());
  };
  momentum = about(H[0]);
  torque = about(F[0]);
  momentum_by_rates.resize(3, tree.planned);
  momentum_by_joints = torque_by_joints = torque_by_rates = momentum_by_rates;
  for (int k = 0; k < tree.planned; ++k) {
    const Vector3 moved = of_center.col(k);
    momentum_by_rates.col(k) = about(h_by_rates.col(k));
    momentum_by_joints.col(k) = about(h_by_joints.col(k)) - moved.cross(H[0].head<3>());
    torque_by_rates.col(k) = about(f_by_rates.col(k));
    torque_by_joints.col(k) = about(f_by_joints.col(k)) - moved.cross(F[0].head<3>());
  }
}

}  // namespace ff

#include "kinematics/system_momentum.hpp"

#include <Eigen/LU>

namespace ff {

SystemMomentum::SystemMomentum(const Posture& posture, Base base)
    : screws_(posture.screws),
      body_(posture.body.begin(), posture.body.begin() + posture.screws.cols() + 1),
      composite_(posture.composite.begin(), posture.composite.begin() + posture.screws.cols() + 1) {
  const int n = static_cast<int>(screws_.cols());
  const Inertia& all = composite_[0];
  Matrix6J momenta(6, n);  // of unit rates
  for (int k = 0; k < n; ++k) momenta.col(k) = composite_[k + 1] * screws_.col(k);
  center = all.first / all.mass;
  const Matrix3 lever = skew(center);
  of_center = momenta.topRows<3>() / all.mass;
  coupling = momenta.bottomRows<3>() - lever.lazyProduct(momenta.topRows<3>());
  const Matrix3 inertia = all.second + all.mass * lever * lever;  // I
  to_rate.setZero();
  if (base == Base::kPlanar)  // the table lets the base turn about its normal alone
    to_rate(2, 2) = 1 / inertia(2, 2);
  else if (base == Base::kFree)
    to_rate = inertia.inverse();
}

Matrix6J SystemMomentum::by_joints(const Vector3& base_rate, const Joints& rates) const {
  const int n = static_cast<int>(screws_.cols());
  std::array<Vector6, kMaxJoints + 1> twists;  // V_k, of the bodies
  twists[0] = stack(Vector3::Zero(), base_rate);
  for (int k = 0; k < n; ++k) twists[k + 1] = twists[k] + screws_.col(k) * rates[k];
  Matrix6J by(6, n);
  Vector6 beyond = Vector6::Zero();  // G_k: momentum of body k and of all that it carries
  for (int k = n - 1; k >= 0; --k) {
    const Vector6 s = screws_.col(k);
    beyond += body_[k + 1] * twists[k + 1];
    // d(H v) / d theta_k = S_k x* G_k - I^c_k (S_k x V_k)
    by.col(k) = cross_force(s, beyond) - composite_[k + 1] * cross_motion(s, twists[k + 1]);
  }
  beyond += body_[0] * twists[0];
  // From the base's origin to the centre of mass c: L - c x P
  const Vector3 linear = beyond.head<3>();  // P
  by.bottomRows<3>() +=
      skew(linear).lazyProduct(of_center) - skew(center).lazyProduct(by.topRows<3>());
  return by;
}

}  // namespace ff

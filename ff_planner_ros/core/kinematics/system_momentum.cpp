#include "kinematics/system_momentum.hpp"

#include <Eigen/LU>

namespace ff {

SystemMomentum::SystemMomentum(const Posture& posture, Base base)
    : tree_(posture.tree),
      screws_(posture.screws),
      body_(posture.body.begin(), posture.body.begin() + posture.screws.cols() + 1),
      composite_(posture.composite.begin(), posture.composite.begin() + posture.screws.cols() + 1) {
  const int n = static_cast<int>(screws_.cols());
  const Inertia& all = composite_[0];
  Matrix6J momenta(6, n);  // of unit rates
  for (int k = 0; k < n; ++k) momenta.col(k) = composite_[k + 1] * screws_.col(k);
  center = all.first / all.mass;
  const Matrix3 lever = skew(center);
  momenta = tree_->by_planned(momenta);
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
  const Joints all = tree_->rates(rates);
  std::array<Vector6, kMaxJoints + 1> twists;  // V_k, of the bodies
  twists[0] = stack(Vector3::Zero(), base_rate);
  for (int k = 0; k < n; ++k) twists[k + 1] = twists[tree_->before[k]] + screws_.col(k) * all[k];
  std::array<Vector6, kMaxJoints + 1> momenta;  // G_k: of body k and of all that it carries
  for (int k = 0; k <= n; ++k) momenta[k] = body_[k] * twists[k];
  add_beyond(*tree_, momenta);
  Matrix6J by(6, n);
  for (int k = 0; k < n; ++k) {
    const Vector6 s = screws_.col(k);
    // d(H v) / d theta_k = S_k x* G_k - I^c_k (S_k x V_k)
    by.col(k) = cross_force(s, momenta[k + 1]) - composite_[k + 1] * cross_motion(s, twists[k + 1]);
  }
  by = tree_->by_planned(by);
  // From the base's origin to the centre of mass c: L - c x P
  const Vector3 linear = momenta[0].head<3>();  // P
  by.bottomRows<3>() +=
      skew(linear).lazyProduct(of_center) - skew(center).lazyProduct(by.topRows<3>());
  return by;
}

}  // namespace ff

// The system about its centre of mass at given joint angles, in base axes. With the base's rate
// omega and the joints' rates theta', Eq. (27) says there: I omega + A theta' = R^T L.
#pragma once
#include "kinematics/chain.hpp"

namespace ff {

using Columns3 = Eigen::Matrix<double, 3, Eigen::Dynamic>;
using Columns6 = Eigen::Matrix<double, 6, Eigen::Dynamic>;

class SystemMomentum {
 public:
  Vector3 center;      // of mass, from the base's origin [m]
  Columns3 of_center;  // its derivative by the joints
  Columns3 coupling;   // A
  Matrix3 to_rate;     // angular momentum to the base's rate, I^-1

  SystemMomentum(const Posture& posture, Base base)
      : screws_(posture.screws),
        body_(posture.body.begin(), posture.body.begin() + posture.screws.cols() + 1),
        composite_(posture.composite.begin(),
                   posture.composite.begin() + posture.screws.cols() + 1) {
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

  // Derivatives of both momenta by the joints, all velocities being fixed: three rows of the linear
  // one, three of the angular one about the centre of mass.
  Matrix6J by_joints(const Vector3& base_rate, const Joints& rates) const {
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

 private:
  Columns6 screws_;
  std::vector<Inertia> body_, composite_;
};

}  // namespace ff

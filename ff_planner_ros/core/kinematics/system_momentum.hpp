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

  SystemMomentum(const Posture& posture, Base base);

  // Derivatives of both momenta by the joints, all velocities being fixed: three rows of the linear
  // one, three of the angular one about the centre of mass.
  Matrix6J by_joints(const Vector3& base_rate, const Joints& rates) const;

 private:
  std::shared_ptr<const Tree> tree_;
  Columns6 screws_;
  std::vector<Inertia> body_, composite_;
};

}  // namespace ff

// The arm as the chain of line segments between its joints, Sec. 3.3 of the paper.
#pragma once
#include "kinematics/chain.hpp"

namespace ff {

using ArmPoints = Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, kMaxJoints + 1>;

// Origins of the joints from base to tip, then the end effector, and what all joints turn about or
// slide along; inertial frame.
struct Arm {
  const Tree& tree;
  ArmPoints points;
  Matrix3J origins, axes, slides;
  Vector3 base;
  Matrix3 base_to_inertial;

  Arm(const Chain& chain, const Configuration& q);

  Vector3 end_effector() const { return points.rightCols<1>(); }
  // Derivative, along a direction, of a place on a body: by a step of the base in its own axes, and
  // by the joints; those that are planned.
  Velocity gradient_of_carried(int body, const Vector3& place, const Vector3& direction) const;

  // Writes d points along steps dq, a column each: rows 3 k to 3 k + 2 are of point k.
  void derivatives(const Eigen::Ref<const RowMajor>& dq, Eigen::Ref<RowMajor> d_points) const;

 private:
  // Adds turn x lever, column by column.
  static void add_cross(Matrix3X& to, const Matrix3X& turn, const Vector3& lever);
};

}  // namespace ff

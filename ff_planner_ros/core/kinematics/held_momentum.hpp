// What wheels hold and give that keep the base from turning: the angular momentum about the centre
// of mass, its rate, and their derivatives by the joints; in base axes. Derivatives of forces are
// those of the recursive Newton-Euler algorithm [Carpentier and Mansard, 2018].
#pragma once
#include <vector>

#include "kinematics/chain.hpp"

namespace ff {

class HeldMomentum {
 public:
  Vector3 momentum, torque;
  // Derivatives, a column a joint. By the accelerations the torque has those of the momentum by the
  // rates.
  Matrix3J momentum_by_joints, momentum_by_rates, torque_by_joints, torque_by_rates;

  HeldMomentum(const Posture& posture, const Joints& rates, const Joints& accelerations);
};

}  // namespace ff

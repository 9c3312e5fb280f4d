// The end effector's pose, velocity and acceleration in a state that nothing pushes, and how they
// change with the state. In base axes, if nothing else is said.
#pragma once
#include <Eigen/Cholesky>

#include "kinematics/system_momentum.hpp"

namespace ff {

struct SystemState {
  Vector3 position;  // of the base, inertial axes
  Matrix3 rotation;  // base to inertial axes
  Vector6 base_twist;
  Joints rates, accelerations;
};

// A change of a state: of the base, in its own axes, and of the joints.
struct StateChange {
  Vector6 base_step, base_twist;
  Joints angles, rates, accelerations;
};

// A change of the end effector's motion, in axes of the end effector.
struct EndEffectorChange {
  Vector6 way = Vector6::Zero(), twist = Vector6::Zero(), acceleration = Vector6::Zero();
};

// How its motion changes with the state, a column an entry: with the base's step and twist, and
// with the joints' angles, rates and accelerations.
struct EndEffectorDerivatives {
  Matrix6 to_tip;  // of way and twist by those of the base
  Matrix6 acceleration_by_twist;
  Matrix6J jacobian;  // of the way by angles, the twist by rates, the acceleration by those
  Matrix6J twist_by_angles, acceleration_by_angles, acceleration_by_rates;
  Matrix6J acceleration_by_accelerations;

  EndEffectorChange along(const StateChange& by) const;
};

class EndEffectorMotion {
 public:
  Vector3 position;             // inertial axes
  Matrix3 rotation;             // to inertial axes
  Vector6 twist, acceleration;  // in axes of the end effector; the latter as it is seen, classical

  EndEffectorMotion(const Posture& posture, const SystemState& state, Base base);

  // By sums over the bodies from k on [Carpentier and Mansard, Analytical derivatives of rigid body
  // dynamics algorithms, RSS 2018]. Where the twist of each changes by u and its acceleration by
  // a + u x (V_i - V_k), the wrench on the base changes by
  //     I^c_k (a + V_k x u) + C_k u,   C_k u = sum of V_i x* I_i u - I_i (V_i x u) + u x* I_i V_i.
  EndEffectorDerivatives derivatives() const;

 private:
  struct Body {
    Vector6 twist, acceleration, momentum, force;  // V, A, I V, I A
  };

  // Goes from body to body; returns the wrench on the base that their motion takes.
  Vector6 follow(const Vector6& of_base);

  // How many entries of the base's motion a table, or wheels, leave no freedom.
  int borne() const { return std::min(3, 6 - first_borne_); }

  // Of a base that can move freely, on a table in x, y and the turn about z, or without a turn.
  Matrix6 free_inertia(Matrix6 inertia) const;

  // What brings a wrench on the base to zero.
  Vector6 base_acceleration(Vector6 wrench) const;

  const Body& of_tip() const { return bodies_[posture_.tree->tip]; }

  const Posture& posture_;
  SystemState state_;
  int first_borne_;  // of the entries of the base's motion that it cannot change; 6: none
  Eigen::LLT<Matrix6> inertia_;
  Matrix6 to_tip_;
  std::vector<Body> bodies_;
};

}  // namespace ff

// The end effector's pose, velocity and acceleration in a state that nothing pushes, and how they
// change with the state. In base axes, if nothing else is said.
#pragma once
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

  static StateChange none(int joints) {
    const Joints still = Joints::Zero(joints);
    return {Vector6::Zero(), Vector6::Zero(), still, still, still};
  }
};

class EndEffectorMotion {
 public:
  Vector3 position;             // inertial axes
  Matrix3 rotation;             // to inertial axes
  Vector6 twist, acceleration;  // in axes of the end effector; the latter as it is seen, classical

  struct Change {
    Vector6 way, twist, acceleration;  // in axes of the end effector
  };

  EndEffectorMotion(const Posture& posture, const SystemState& state, Base base)
      : posture_(posture),
        state_(state),
        first_borne_(base == Base::kPlanar ? 2
                     : base == Base::kHeld ? 3
                                           : 6),
        inertia_(free_inertia(posture.composite[0].matrix())),
        to_tip_(posture.tip.motion_to_inner()) {
    // Nothing pushes the base, Eq. (20): its acceleration is what the wrench needs to be zero.
    follow(base_acceleration(follow(Vector6::Zero())));
    position = state.position + state.rotation * posture.tip.position;
    rotation = state.rotation * posture.tip.rotation;
    twist = to_tip_ * bodies_.back().twist;
    acceleration = to_tip_ * bodies_.back().acceleration;
    // From the spatial to the classical acceleration: omega x v more.
    acceleration.head<3>() += twist.tail<3>().cross(twist.head<3>());
  }

  Change along(const StateChange& by) const {
    Vector6 W = Vector6::Zero();  // the way that the joints move a body, seen from the base
    Vector6 dV = by.base_twist, dA = Vector6::Zero(), wrench = Vector6::Zero();
    for (size_t k = 0; k < bodies_.size(); ++k) {
      const Body& at = bodies_[k];
      if (k > 0) {
        const int joint = static_cast<int>(k) - 1;
        const double of_rate = by.rates[joint], of_acceleration = by.accelerations[joint];
        const double rate = state_.rates[joint], accelerated = state_.accelerations[joint];
        const Vector6 s = posture_.screws.col(joint);
        W += s * by.angles[joint];
        const Vector6 ds = cross_motion(W, s);
        dV += s * of_rate + ds * rate;
        dA += s * of_acceleration + ds * accelerated + cross_motion(dV, s) * rate +
              cross_motion(at.twist, ds * rate + s * of_rate);
      }
      // dI x = W x* I x - I (W x x)
      const Inertia& inertia = posture_.body[k];
      const Vector6 of_momentum =
          cross_force(W, at.momentum) + inertia * Vector6(dV - cross_motion(W, at.twist));
      wrench += cross_force(W, at.force) +
                inertia * Vector6(dA - cross_motion(W, at.acceleration)) +
                cross_force(dV, at.momentum) + cross_force(at.twist, of_momentum);
    }
    dA += base_acceleration(wrench);
    const Body& tip = bodies_.back();
    Change change;
    change.way = to_tip_ * (by.base_step + W);
    change.twist = to_tip_ * (dV - cross_motion(W, tip.twist));
    change.acceleration = to_tip_ * (dA - cross_motion(W, tip.acceleration));
    const Vector3 linear = twist.head<3>(), angular = twist.tail<3>();
    change.acceleration.head<3>() +=
        change.twist.tail<3>().cross(linear) + angular.cross(change.twist.head<3>());
    return change;
  }

 private:
  struct Body {
    Vector6 twist, acceleration, momentum, force;  // V, A, I V, I A
  };

  // Goes from body to body; returns the wrench on the base that their motion takes.
  Vector6 follow(const Vector6& of_base) {
    Vector6 V = state_.base_twist, A = of_base, wrench = Vector6::Zero();
    bodies_.clear();
    for (int k = 0; k <= state_.rates.size(); ++k) {
      if (k > 0) {
        const Vector6 s = posture_.screws.col(k - 1);
        V += s * state_.rates[k - 1];
        A += s * state_.accelerations[k - 1] + cross_motion(V, s) * state_.rates[k - 1];
      }
      const Inertia& inertia = posture_.body[k];
      bodies_.push_back({V, A, inertia * V, inertia * A});
      wrench += inertia * A + cross_force(V, inertia * V);
    }
    return wrench;
  }

  // How many entries of the base's motion a table, or wheels, leave no freedom.
  int borne() const { return std::min(3, 6 - first_borne_); }

  // Of a base that can move freely, on a table in x, y and the turn about z, or without a turn.
  Matrix6 free_inertia(Matrix6 inertia) const {
    for (int fixed = first_borne_; fixed < first_borne_ + borne(); ++fixed) {
      inertia.row(fixed).setZero();
      inertia.col(fixed).setZero();
      inertia(fixed, fixed) = 1;
    }
    return inertia;
  }

  // What brings a wrench on the base to zero.
  Vector6 base_acceleration(Vector6 wrench) const {
    wrench.segment(first_borne_, borne()).setZero();
    return -inertia_.solve(wrench);
  }

  const Posture& posture_;
  SystemState state_;
  int first_borne_;  // of the entries of the base's motion that it cannot change; 6: none
  Eigen::LLT<Matrix6> inertia_;
  Matrix6 to_tip_;
  std::vector<Body> bodies_;
};

}  // namespace ff

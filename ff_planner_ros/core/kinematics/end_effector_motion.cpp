#include "kinematics/end_effector_motion.hpp"

#include "kinematics/cholesky.hpp"

namespace ff {

EndEffectorChange EndEffectorDerivatives::along(const StateChange& by) const {
  return {to_tip * by.base_step + jacobian * by.angles,
          to_tip * by.base_twist + twist_by_angles * by.angles + jacobian * by.rates,
          acceleration_by_twist * by.base_twist + acceleration_by_angles * by.angles +
              acceleration_by_rates * by.rates + acceleration_by_accelerations * by.accelerations};
}

EndEffectorMotion::EndEffectorMotion(const Posture& posture, const SystemState& state, Base base)
    : posture_(posture),
      state_(state),
      first_borne_(base == Base::kPlanar ? 2
                   : base == Base::kHeld ? 3
                                         : 6),
      inertia_(cholesky(free_inertia(posture.composite[0].matrix()))),
      to_tip_(posture.tip.motion_to_inner()) {
  // Nothing pushes the base, Eq. (20): its acceleration is what the wrench needs to be zero.
  follow(base_acceleration(follow(Vector6::Zero())));
  position = state.position + state.rotation * posture.tip.position;
  rotation = state.rotation * posture.tip.rotation;
  twist = to_tip_ * of_tip().twist;
  acceleration = to_tip_ * of_tip().acceleration;
  // From the spatial to the classical acceleration: omega x v more.
  acceleration.head<3>() += twist.tail<3>().cross(twist.head<3>());
}

EndEffectorDerivatives EndEffectorMotion::derivatives() const {
  const Tree& tree = *posture_.tree;
  const int n = tree.joints();
  EndEffectorDerivatives of{to_tip_,        Matrix6(),      Matrix6J(6, n), Matrix6J(6, n),
                            Matrix6J(6, n), Matrix6J(6, n), Matrix6J(6, n)};
  std::vector<Matrix6> of_twists(n + 1, Matrix6::Zero());  // C_k
  std::vector<Vector6> forces(n + 1, Vector6::Zero());     // on body k and all beyond
  for (int k = n; k >= 0; --k) {
    Matrix6& coriolis = of_twists[k];
    Vector6& force = forces[k];
    const Body& at = bodies_[k];
    const Matrix6 carried = posture_.body[k].matrix() * cross_motion_matrix(at.twist);
    const Matrix3 linear = skew(at.momentum.head<3>());
    coriolis -= carried + carried.transpose();
    coriolis.topRightCorner<3, 3>() -= linear;
    coriolis.bottomLeftCorner<3, 3>() -= linear;
    coriolis.bottomRightCorner<3, 3>() -= skew(at.momentum.tail<3>());
    force += at.force + cross_force(at.twist, at.momentum);
    // Of the end effector, where u, a and the wrench change.
    const auto acceleration_by = [&](const Vector6& u, const Vector6& a, Vector6 wrench) {
      wrench += posture_.composite[k] * Vector6(a + cross_motion(at.twist, u)) + coriolis * u;
      if (k > 0 && !tree.moves_tip(k - 1)) return Vector6(to_tip_ * base_acceleration(wrench));
      const Vector6 of_twist = to_tip_ * u, beyond = of_tip().twist - at.twist;
      Vector6 found = to_tip_ * (a + cross_motion(u, beyond) + base_acceleration(wrench));
      found.head<3>() +=
          of_twist.tail<3>().cross(twist.head<3>()) + twist.tail<3>().cross(of_twist.head<3>());
      return found;
    };
    const Vector6 none = Vector6::Zero();
    if (k == 0) {
      for (int entry = 0; entry < 6; ++entry)
        of.acceleration_by_twist.col(entry) = acceleration_by(Vector6::Unit(entry), none, none);
      break;
    }
    // Seen from the bodies that a joint turns, the motion that reaches them turns back.
    const Vector6 s = posture_.screws.col(k - 1), u = -cross_motion(s, at.twist);
    of.jacobian.col(k - 1) = to_tip_ * s;
    of.twist_by_angles.col(k - 1) = to_tip_ * u;
    of.acceleration_by_angles.col(k - 1) =
        acceleration_by(u, -cross_motion(s, at.acceleration), cross_force(s, force));
    of.acceleration_by_rates.col(k - 1) = acceleration_by(s, cross_motion(at.twist, s), none);
    of.acceleration_by_accelerations.col(k - 1) = acceleration_by(none, s, none);
    of_twists[tree.before[k - 1]] += coriolis;
    forces[tree.before[k - 1]] += force;
  }
  of.jacobian = posture_.of_tip(of.jacobian);
  of.twist_by_angles = posture_.of_tip(of.twist_by_angles);
  for (Matrix6J* by : {&of.jacobian, &of.twist_by_angles, &of.acceleration_by_angles,
                       &of.acceleration_by_rates, &of.acceleration_by_accelerations})
    *by = tree.by_planned(*by);
  return of;
}

Vector6 EndEffectorMotion::follow(const Vector6& of_base) {
  const Tree& tree = *posture_.tree;
  const Joints rates = tree.rates(state_.rates), accelerations = tree.rates(state_.accelerations);
  Vector6 V = state_.base_twist, A = of_base, wrench = Vector6::Zero();
  bodies_.clear();
  for (int k = 0; k <= tree.joints(); ++k) {
    if (k > 0) {
      const Vector6 s = posture_.screws.col(k - 1);
      const Body& before = bodies_[tree.before[k - 1]];
      V = before.twist + s * rates[k - 1];
      A = before.acceleration + (s * accelerations[k - 1] + cross_motion(V, s) * rates[k - 1]);
    }
    const Inertia& inertia = posture_.body[k];
    bodies_.push_back({V, A, inertia * V, inertia * A});
    wrench += inertia * A + cross_force(V, inertia * V);
  }
  return wrench;
}

Matrix6 EndEffectorMotion::free_inertia(Matrix6 inertia) const {
  for (int fixed = first_borne_; fixed < first_borne_ + borne(); ++fixed) {
    inertia.row(fixed).setZero();
    inertia.col(fixed).setZero();
    inertia(fixed, fixed) = 1;
  }
  return inertia;
}

Vector6 EndEffectorMotion::base_acceleration(Vector6 wrench) const {
  wrench.segment(first_borne_, borne()).setZero();
  return -solved(inertia_, wrench);
}

}  // namespace ff

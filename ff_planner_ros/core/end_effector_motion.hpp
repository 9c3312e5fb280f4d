// The end effector's pose, velocity and acceleration in a state that nothing pushes, with their
// derivatives along directions, a column each. In base axes, if nothing else is said.
#pragma once
#include "system_momentum.hpp"

namespace ff {

// The state of a system and its derivatives; those of the base in its own axes.
struct SystemState {
  Vector3 position;  // of the base, inertial axes
  Matrix3 rotation;  // base to inertial axes
  Vector6 base_twist;
  Joints rates, accelerations;
  Matrix6X base_step, base_twist_change;
  Eigen::MatrixXd angle_changes, rate_changes, acceleration_changes;  // a row a joint

  int directions() const { return static_cast<int>(base_step.cols()); }
};

// The matrix of `cross_force` with `by`, and that of its change with `by` at a fixed force.
inline Matrix6 cross_force_matrix(const Vector6& by) {
  return -cross_motion_matrix(by).transpose();
}
inline Matrix6 crossed_by(const Vector6& force) {
  Matrix6 matrix = Matrix6::Zero();
  matrix.topRightCorner<3, 3>() = matrix.bottomLeftCorner<3, 3>() = -skew(force.head<3>());
  matrix.bottomRightCorner<3, 3>() = -skew(force.tail<3>());
  return matrix;
}

class EndEffectorMotion {
 public:
  Vector3 position;                        // inertial axes
  Matrix3 rotation;                        // to inertial axes
  Vector6 twist, acceleration;             // of the end effector, in its axes; classical
  Matrix6X way, twist_by, acceleration_by;  // derivatives, in its axes

  EndEffectorMotion(const Posture& posture, const SystemState& state, bool planar)
      : state_(state), wrench_(Vector6::Zero()) {
    // Nothing pushes the base, Eq. (20): its acceleration is what the wrench needs to be zero.
    follow(posture, Vector6::Zero());
    const Vector6 base = freed(posture, wrench_, planar);
    follow(posture, base);
    tip_acceleration_change_ += freed(posture, wrench_by_, planar);

    const Matrix6 to_tip = posture.tip.motion_to_inner();
    position = state.position + state.rotation * posture.tip.position;
    rotation = state.rotation * posture.tip.rotation;
    way = to_tip * (state.base_step + turned_);
    twist = to_tip * tip_twist_;
    twist_by = to_tip * (tip_twist_change_ + cross_motion_matrix(tip_twist_) * turned_);
    acceleration = to_tip * tip_acceleration_;
    acceleration_by =
        to_tip * (tip_acceleration_change_ + cross_motion_matrix(tip_acceleration_) * turned_);
    // From the spatial to the classical acceleration: omega x v more.
    const Vector3 linear = twist.head<3>(), angular = twist.tail<3>();
    acceleration.head<3>() += angular.cross(linear);
    acceleration_by.topRows<3>() +=
        skew(angular) * twist_by.topRows<3>() - skew(linear) * twist_by.bottomRows<3>();
  }

 private:
  // Goes from body to body and adds up what moves each of them and what force that takes.
  void follow(const Posture& posture, const Vector6& base_acceleration) {
    const int n = static_cast<int>(state_.rates.size());
    Vector6 V = state_.base_twist, A = base_acceleration;
    Matrix6X W = Matrix6X::Zero(6, state_.directions());  // turns in the base's frame
    Matrix6X dV = state_.base_twist_change, dA = W;
    wrench_.setZero(), wrench_by_ = W;
    for (int k = 0; k <= n; ++k) {
      if (k > 0) {
        const Vector6 s = posture.screws.col(k - 1);
        const double rate = state_.rates[k - 1], accelerated = state_.accelerations[k - 1];
        W += s * state_.angle_changes.row(k - 1);
        const Matrix6X ds = -cross_motion_matrix(s) * W;  // W x s
        // V_k = V + s theta',  A_k = A + s theta'' + V x s theta'
        V += s * rate;
        dV += s * state_.rate_changes.row(k - 1) + ds * rate;
        A += s * accelerated + cross_motion(V, s) * rate;
        dA += s * state_.acceleration_changes.row(k - 1) + ds * accelerated;
        dA += cross_motion_matrix(V) * (ds * rate + s * state_.rate_changes.row(k - 1));
        dA -= rate * cross_motion_matrix(s) * dV;
      }
      const Inertia& body = posture.body[k];
      const Matrix6 inertia = body.matrix();
      const Vector6 momentum = body * V, force = body * A;
      // f = I A + V x* I V, and dI x = W x* I x - I (W x x)
      wrench_ += force + cross_force(V, momentum);
      const Matrix6X of_momentum =
          crossed_by(momentum) * W + inertia * (dV + cross_motion_matrix(V) * W);
      wrench_by_ += crossed_by(force) * W + inertia * (dA + cross_motion_matrix(A) * W);
      wrench_by_ += crossed_by(momentum) * dV + cross_force_matrix(V) * of_momentum;
    }
    tip_twist_ = V, tip_acceleration_ = A, turned_ = W;
    tip_twist_change_ = dV, tip_acceleration_change_ = dA;
  }

  // Accelerations that a base which can move takes from wrenches on it; on a table x, y and the turn.
  static Matrix6X freed(const Posture& posture, const Matrix6X& wrenches, bool planar) {
    const Matrix6 inertia = posture.composite[0].matrix();
    if (!planar) return -inertia.llt().solve(wrenches);
    Eigen::Matrix<double, 6, 3> rows = Eigen::Matrix<double, 6, 3>::Zero();
    rows(0, 0) = rows(1, 1) = rows(5, 2) = 1;
    const Matrix3 there = rows.transpose() * inertia * rows;
    return -rows * there.llt().solve(rows.transpose() * wrenches);
  }

  const SystemState& state_;
  Vector6 wrench_, tip_twist_, tip_acceleration_;
  Matrix6X wrench_by_, turned_, tip_twist_change_, tip_acceleration_change_;
};

}  // namespace ff

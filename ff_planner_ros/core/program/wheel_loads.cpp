#include "program/wheel_loads.hpp"

namespace ff {

WheelLoads::WheelLoads(const Chain& chain, const Wheels& wheels, const PathMotion& motion,
                       const PathDerivatives& by_x, double step) {
  const Eigen::Index n = chain.joints(), size = 6 + n, points = motion.points(),
                     x = motion.variables(), count = wheels.count();
  momenta.resize(points, count);
  momenta_by_x.resize(points, count * x);
  torques = momenta;
  torques_by_x = momenta_by_x;
  const JointsAtPoints joints = joints_of(motion, by_x);
  JointAccelerations moved(joints, step);
  moved.differentiate(joints, step, motion.has_duration());
  Vector3 momentum_at_start;
  RowMajor by_x_at_start;
  for (Eigen::Index i = 0; i < points; ++i) {
    const HeldMomentum at(Posture(chain, joints.positions.row(i)), joints.rates.row(i),
                          moved.values.row(i));
    const auto positions_by_x = by_x.q.middleRows(size * i + 6, n),
               rates_by_x = by_x.v.middleRows(size * i + 6, n);
    const Rows accelerations_by_x(moved.by_x.row(i).data(), n, x);
    RowMajor momentum_by_x = at.momentum_by_joints * positions_by_x;
    momentum_by_x.noalias() += at.momentum_by_rates * rates_by_x;
    RowMajor torque_by_x = at.torque_by_joints * positions_by_x;
    torque_by_x.noalias() += at.torque_by_rates * rates_by_x;
    torque_by_x.noalias() += at.momentum_by_rates * accelerations_by_x;
    if (i == 0) {
      momentum_at_start = at.momentum;
      by_x_at_start = momentum_by_x;
    }
    momenta.row(i) = wheels.stored + wheels.shares * (momentum_at_start - at.momentum);
    torques.row(i) = -(wheels.shares * at.torque);
    RowsToFill(momenta_by_x.row(i).data(), count, x) =
        wheels.shares * (by_x_at_start - momentum_by_x);
    RowsToFill(torques_by_x.row(i).data(), count, x) = -(wheels.shares * torque_by_x);
  }
}

}  // namespace ff

#include "program/follows_path.hpp"

#include "kinematics/rotation.hpp"

namespace ff {

void FollowsPath::require_fits(const Tree&, Eigen::Index points) const {
  const Eigen::Index times = 2 * (points - 1);
  require(positions.rows() == times && positions.cols() == 3,
          "positions are those of another number of points");
  require(!turns() || (rotations.rows() == 3 * times && rotations.cols() == 3),
          "rotations are those of another number of points");
}

ConstraintRows FollowsPath::rows(const LookedAt& at) const {
  const Path path = at.path();
  const Eigen::Index size = 6 + at.chain.joints();
  ConstraintRows found;
  for (Eigen::Index i = 0; i < path.q.rows(); ++i) {
    const Configuration q = Configuration::read(path.q.row(i));
    const Arm arm(at.chain, q);
    const Vector3 tip = arm.end_effector();
    const auto add = [&](int component, double error, double bound, const Velocity& by_q) {
      const Eigen::RowVectorXd by_x = by_q.transpose() * path.dq.middleRows(i * size, size);
      found.add(bound - error, 2 * (6 * i + component), -by_x);
      found.add(bound + error, 2 * (6 * i + component) + 1, by_x);
    };
    for (int k = 0; k < 3; ++k)
      if (counts[k] != 0)
        add(k, tip[k] - positions(i, k), position,
            arm.gradient_of_carried(arm.tree.tip, tip, Vector3::Unit(k)));
    if (!turns()) continue;
    const Pose base{q.position, arm.base_to_inertial};
    const Pose pose = at.chain.body(base, arm.tree.tip, q.joints) * at.chain.tip;
    const Matrix3 wanted = rotations.middleRows<3>(3 * i);
    // The turn from the path to the end effector, as a vector in the path's axes and in inertial
    // ones; the end effector's own axes are those of its derivative.
    const Vector3 turn = turn_of(wanted.transpose() * pose.rotation);
    const Vector3 error = wanted * turn;
    const Matrix3 by_turn = wanted * turn_of_derivative(turn) * pose.rotation.transpose();
    for (int k = 0; k < 3; ++k) {
      if (counts[3 + k] == 0) continue;
      const Vector3 about = by_turn.row(k);
      Velocity by_q = Velocity::Zero(size);
      by_q.segment<3>(3) = arm.base_to_inertial.transpose() * about;
      for (const int j : arm.tree.moving(arm.tree.tip))
        by_q[6 + arm.tree.drives[j].planned] +=
            arm.tree.drives[j].multiplier * arm.axes.col(j).dot(about);
      add(3 + k, error[k], orientation, by_q);
    }
  }
  return found;
}

}  // namespace ff

#include "kinematics/chain.hpp"

namespace ff {

bool are_finite(const Values& numbers) { return (numbers - numbers).sum() == 0; }

Pose Chain::moved(const Pose& at, int joint, double by) const {
  return {at.position + at.rotation * (slides[joint] * by),
          at.rotation * rotation_about(axes[joint], by)};
}

Configuration Configuration::read(const Eigen::Ref<const Eigen::RowVectorXd>& q) {
  return {q.head<3>(), Eigen::Quaterniond(q[6], q[3], q[4], q[5]), q.tail(q.size() - 7)};
}

void Configuration::write(Eigen::Ref<Eigen::RowVectorXd> q) const {
  q << position.transpose(), attitude.coeffs().transpose(), joints.transpose();
}

Configuration Configuration::step(const Velocity& by) const {
  const Vector6 of_base = by.head<6>();
  return {position + attitude * exponential(of_base).position,
          (attitude * turn(of_base)).normalized(), joints + by.tail(joints.size())};
}

Posture::Posture(const Chain& chain, const Joints& joints) : screws(6, chain.joints()) {
  const int n = chain.joints();
  Pose at{Vector3::Zero(), Matrix3::Identity()};
  body[0] = Inertia::of_body(chain.masses[0], chain.centers[0], chain.inertias[0]);
  for (int k = 0; k < n; ++k) {
    at = at * chain.placements[k];
    const Vector3 axis = at.rotation * chain.axes[k], slide = at.rotation * chain.slides[k];
    screws.col(k) = stack(at.position.cross(axis) + slide, axis);
    at = chain.moved(at, k, joints[k]);
    body[k + 1] =
        Inertia::of_body(chain.masses[k + 1], at.position + at.rotation * chain.centers[k + 1],
                         at.rotation * chain.inertias[k + 1] * at.rotation.transpose());
  }
  tip = at * chain.tip;
  composite[n] = body[n];
  for (int k = n - 1; k >= 0; --k) composite[k] = composite[k + 1] + body[k];
}

}  // namespace ff

#include "kinematics/arm.hpp"

namespace ff {

Arm::Arm(const Chain& chain, const Configuration& q)
    : tree(*chain.tree),
      points(3, tree.moving(tree.tip).size() + 1),
      origins(3, tree.joints()),
      axes(3, tree.joints()),
      slides(3, tree.joints()),
      base(q.position),
      base_to_inertial(q.attitude.toRotationMatrix()) {
  const Joints positions = tree.positions(q.joints);
  std::array<Pose, kMaxJoints + 1> frames;  // of the bodies
  frames[0] = {base, base_to_inertial};
  for (int k = 0; k < tree.joints(); ++k) {
    Pose& at = frames[k + 1] = frames[tree.before[k]] * chain.placements[k];
    axes.col(k) = at.rotation * chain.axes[k];
    slides.col(k) = at.rotation * chain.slides[k];
    at = chain.moved(at, k, positions[k]);
    origins.col(k) = at.position;
  }
  int number = 0;
  for (const int k : tree.moving(tree.tip)) points.col(number++) = origins.col(k);
  points.col(number) = (frames[tree.tip] * chain.tip).position;
}

Velocity Arm::gradient_of_carried(int body, const Vector3& place, const Vector3& direction) const {
  const int count = tree.is_chain() ? body : tree.planned;
  Velocity by_q(6 + count);
  by_q.head<3>() = base_to_inertial.transpose() * direction;
  by_q.segment<3>(3) = base_to_inertial.transpose() * (place - base).cross(direction);
  by_q.tail(count).setZero();
  for (const int j : tree.moving(body))
    by_q[6 + tree.drives[j].planned] +=
        tree.drives[j].multiplier *
        (axes.col(j).dot((place - origins.col(j)).cross(direction)) + slides.col(j).dot(direction));
  return by_q;
}

void Arm::derivatives(const Eigen::Ref<const RowMajor>& dq, Eigen::Ref<RowMajor> d_points) const {
  Matrix3X turn = base_to_inertial * dq.middleRows<3>(3);  // of the body that carries the point
  Matrix3X moved = base_to_inertial * dq.topRows<3>();
  Vector3 from = base;
  const std::vector<int>& moving = tree.moving(tree.tip);
  for (int k = 0; k < points.cols(); ++k) {
    add_cross(moved, turn, points.col(k) - from);
    const bool is_tip = k == static_cast<int>(moving.size());
    const int joint = is_tip ? 0 : moving[k];
    const Tree::Drive& drive = tree.drives[joint];
    if (!is_tip && !slides.col(joint).isZero(0))
      moved += drive.multiplier * slides.col(joint) * dq.row(6 + drive.planned);
    d_points.middleRows<3>(3 * k) = moved;
    from = points.col(k);
    if (!is_tip) turn.noalias() += drive.multiplier * axes.col(joint) * dq.row(6 + drive.planned);
  }
}

void Arm::add_cross(Matrix3X& to, const Matrix3X& turn, const Vector3& lever) {
  to.row(0) += turn.row(1) * lever.z() - turn.row(2) * lever.y();
  to.row(1) += turn.row(2) * lever.x() - turn.row(0) * lever.z();
  to.row(2) += turn.row(0) * lever.y() - turn.row(1) * lever.x();
}

}  // namespace ff

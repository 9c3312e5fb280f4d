#include "kinematics/arm.hpp"

namespace ff {

Arm::Arm(const Chain& chain, const Configuration& q)
    : points(3, chain.joints() + 1),
      axes(3, chain.joints()),
      slides(3, chain.joints()),
      base(q.position),
      base_to_inertial(q.attitude.toRotationMatrix()) {
  Pose at{base, base_to_inertial};
  for (int k = 0; k < chain.joints(); ++k) {
    at = at * chain.placements[k];
    axes.col(k) = at.rotation * chain.axes[k];
    slides.col(k) = at.rotation * chain.slides[k];
    at = chain.moved(at, k, q.joints[k]);
    points.col(k) = at.position;
  }
  points.col(chain.joints()) = (at * chain.tip).position;
}

Velocity Arm::gradient_of_carried(int count, const Vector3& place, const Vector3& direction) const {
  Velocity by_q(6 + count);
  by_q.head<3>() = base_to_inertial.transpose() * direction;
  by_q.segment<3>(3) = base_to_inertial.transpose() * (place - base).cross(direction);
  for (int j = 0; j < count; ++j)
    by_q[6 + j] =
        axes.col(j).dot((place - points.col(j)).cross(direction)) + slides.col(j).dot(direction);
  return by_q;
}

void Arm::derivatives(const Eigen::Ref<const RowMajor>& dq, Eigen::Ref<RowMajor> d_points) const {
  Matrix3X turn = base_to_inertial * dq.middleRows<3>(3);  // of the body that carries the point
  Matrix3X moved = base_to_inertial * dq.topRows<3>();
  Vector3 from = base;
  for (int k = 0; k < points.cols(); ++k) {
    add_cross(moved, turn, points.col(k) - from);
    if (k < slides.cols() && !slides.col(k).isZero(0)) moved += slides.col(k) * dq.row(6 + k);
    d_points.middleRows<3>(3 * k) = moved;
    from = points.col(k);
    if (k < axes.cols()) turn.noalias() += axes.col(k) * dq.row(6 + k);
  }
}

void Arm::add_cross(Matrix3X& to, const Matrix3X& turn, const Vector3& lever) {
  to.row(0) += turn.row(1) * lever.z() - turn.row(2) * lever.y();
  to.row(1) += turn.row(2) * lever.x() - turn.row(0) * lever.z();
  to.row(2) += turn.row(0) * lever.y() - turn.row(1) * lever.x();
}

}  // namespace ff

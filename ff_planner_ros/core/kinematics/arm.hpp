// The arm as the chain of line segments between its joints, Sec. 3.3 of the paper.
#pragma once
#include "kinematics/chain.hpp"

namespace ff {

using ArmPoints = Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, kMaxJoints + 1>;

// Joint origins, then the end effector, and what the joints turn about or slide along; inertial
// frame.
struct Arm {
  ArmPoints points;
  Matrix3J axes, slides;
  Vector3 base;
  Matrix3 base_to_inertial;

  Arm(const Chain& chain, const Configuration& q)
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

  // Derivative, along a direction, of the place a fraction of the way from point k to the next: by
  // a step of the base in its own axes, and by the joints that move it.
  Velocity gradient(int k, double fraction, const Vector3& direction) const {
    const Vector3 place = (1 - fraction) * points.col(k) + fraction * points.col(k + 1);
    const int joints = static_cast<int>(axes.cols());
    Velocity by_q(6 + std::min(k + 2, joints));
    by_q.head(7 + k) = gradient_of_carried(k + 1, place, direction);
    // Where the next joint slides, the segment's end alone moves with it.
    if (k + 1 < joints) by_q[7 + k] = fraction * slides.col(k + 1).dot(direction);
    return by_q;
  }

  // The same of a place that the first joints, so many, carry along.
  Velocity gradient_of_carried(int count, const Vector3& place, const Vector3& direction) const {
    Velocity by_q(6 + count);
    by_q.head<3>() = base_to_inertial.transpose() * direction;
    by_q.segment<3>(3) = base_to_inertial.transpose() * (place - base).cross(direction);
    for (int j = 0; j < count; ++j)
      by_q[6 + j] =
          axes.col(j).dot((place - points.col(j)).cross(direction)) + slides.col(j).dot(direction);
    return by_q;
  }

  // Writes d points along steps dq, a column each: rows 3 k to 3 k + 2 are of point k.
  void derivatives(const Eigen::Ref<const RowMajor>& dq, Eigen::Ref<RowMajor> d_points) const {
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

 private:
  // Adds turn x lever, column by column.
  static void add_cross(Matrix3X& to, const Matrix3X& turn, const Vector3& lever) {
    to.row(0) += turn.row(1) * lever.z() - turn.row(2) * lever.y();
    to.row(1) += turn.row(2) * lever.x() - turn.row(0) * lever.z();
    to.row(2) += turn.row(0) * lever.y() - turn.row(1) * lever.x();
  }
};

}  // namespace ff

#include "program/goal_requirements.hpp"

namespace ff {

Vector6 GraspSeen::by_duration(Eigen::Index i, const Vector6& of_goal) const {
  const Vector6 own = twists.row(i);
  return moves_with_goal ? Vector6(of_goal + own) : own;
}

OffAxis::OffAxis(const Vector3& place, const Vector3& axis) : along(place.dot(axis)) {
  const Vector3 aside = place - along * axis;
  lateral = aside.norm();
  outward = aside / std::max(lateral, kTiny);
}

double OffAxis::inside(double half_angle) const {
  return along * std::sin(half_angle) - lateral * std::cos(half_angle);
}

void InCorridor::require_fits(const Tree&, Eigen::Index points) const {
  require(grasp.fits(points), "grasp is that of another number of points");
}

ConstraintRows InCorridor::rows(const LookedAt& at) const {
  const Path path = at.path();
  const Eigen::Index joints = at.chain.joints(), size = 6 + joints;
  ConstraintRows found;
  for (Eigen::Index i = 0; i < path.q.rows(); ++i) {
    const Arm arm(at.chain, Configuration::read(path.q.row(i)));
    const Vector3 from_grasp = arm.end_effector() - grasp.position(i);
    const Matrix3 to_inertial = grasp.rotation(i);
    const Vector3 place = to_inertial.transpose() * grasp.counts.cwiseProduct(from_grasp);
    const OffAxis seen(place, -direction);
    const double away = place.norm(), beyond = away - distance;
    const double in_cone = radius * std::cos(half_angle) + seen.inside(half_angle);
    const bool by_cone = in_cone >= beyond;
    const double value =
        (by_cone ? in_cone : beyond) - back_off - margin * std::min(away / distance, 1.0);
    if (value >= interest) continue;
    const Vector3 outward = place / std::max(away, kTiny);
    Vector3 by_place = outward;
    if (by_cone) by_place = -std::sin(half_angle) * direction - std::cos(half_angle) * seen.outward;
    if (away < distance) by_place -= margin / distance * outward;
    const Vector3 by_point = grasp.counts.cwiseProduct(to_inertial * by_place);
    const Velocity by_q = arm.gradient_of_carried(arm.tree.tip, arm.end_effector(), by_point);
    Eigen::RowVectorXd by_x = by_q.transpose() * path.dq.middleRows(i * size, size);
    if (at.motion.has_duration()) {
      const Vector6 moved = grasp.by_duration(i, *at.motion.goal_by_duration);
      const Vector3 turn = moved.tail<3>();
      by_x[by_x.size() - 1] -= by_point.dot(moved.head<3>() + turn.cross(from_grasp));
    }
    found.add(value, 2 * i + by_cone, by_x);
  }
  return found;
}

void GoalInView::require_fits(const Tree& tree, Eigen::Index points) const {
  require(grasp.fits(points), "grasp is that of another number of points");
  require(carrier <= tree.joints(), "carrier is a link of another chain");
}

ConstraintRows GoalInView::rows(const LookedAt& at) const {
  const Path path = at.path();
  const Eigen::Index size = 6 + at.chain.joints();
  ConstraintRows found;
  for (Eigen::Index i = 0; i < path.q.rows(); ++i) {
    const Configuration q = Configuration::read(path.q.row(i));
    const Pose camera = camera_at(at.chain, q);
    const Vector3 goal = grasp.position(i);
    const Vector3 place = camera.rotation.transpose() * (goal - camera.position);
    const OffAxis seen(place, axis);
    const double away = place.norm(), near = until - away;
    const bool by_angle = seen.inside(half_angle) >= near;
    const double value = by_angle ? half_angle - std::atan2(seen.lateral, seen.along) - margin
                                  : near - margin * until;
    if (value >= interest) continue;
    const double square = seen.along * seen.along + seen.lateral * seen.lateral;
    const Vector3 by_place =
        by_angle
            ? Vector3((seen.lateral * axis - seen.along * seen.outward) / std::max(square, kTiny))
            : Vector3(-place / std::max(away, kTiny));
    const Vector3 by_goal = camera.rotation * by_place;
    // What moves the camera moves the goal the other way in its view.
    const Velocity by_q = -Arm(at.chain, q).gradient_of_carried(carrier, goal, by_goal);
    Eigen::RowVectorXd by_x = by_q.transpose() * path.dq.middleRows(i * size, by_q.size());
    if (at.motion.has_duration()) {
      const Vector6 moved = grasp.by_duration(i, *at.motion.goal_by_duration);
      by_x[by_x.size() - 1] += by_goal.dot(moved.head<3>());
    }
    found.add(value, 2 * i + by_angle, by_x);
  }
  return found;
}

Pose GoalInView::camera_at(const Chain& chain, const Configuration& q) const {
  const Pose base{q.position, q.attitude.toRotationMatrix()};
  return chain.body(base, carrier, q.joints) * Pose{position, rotation};
}

}  // namespace ff

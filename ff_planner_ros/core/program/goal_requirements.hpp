// The corridor to the goal's grasp frame, and a camera's view of it, along a path.
#pragma once
#include "kinematics/arm.hpp"
#include "program/path_requirement.hpp"

namespace ff {

// The grasp frame at the times of `LookedAt::path`, a row or three a time; inertial axes.
struct GraspSeen {
  RowMajor positions, rotations;  // rotations: to inertial axes
  Vector3 counts;                 // ones; on a table the height does not count: zero
  // How it moves with the duration T at fixed t / T: by twists of its own, and with the goal.
  RowMajor twists;
  bool moves_with_goal;

  Vector3 position(Eigen::Index i) const { return positions.row(i); }
  Matrix3 rotation(Eigen::Index i) const { return rotations.middleRows<3>(3 * i); }
  Vector6 by_duration(Eigen::Index i, const Vector6& of_goal) const;
  bool fits(Eigen::Index points) const { return positions.rows() == 2 * (points - 1); }
};

constexpr double kTiny = std::numeric_limits<double>::min();

// A place as a cone with its apex at the origin sees it.
struct OffAxis {
  double along, lateral;
  Vector3 outward;  // unit length; on the axis zero

  OffAxis(const Vector3& place, const Vector3& axis);
  // How far it is inside the cone.
  double inside(double half_angle) const;
};

// The end effector in the corridor, or further from the grasp than its distance, whichever is more.
struct InCorridor : PathRequirement {
  GraspSeen grasp;
  Vector3 direction;  // of the approach, unit length, in the grasp frame
  double distance, half_angle;
  double radius;    // of the corridor at the grasp [m]
  double back_off;  // by which it is narrower, all along [m]
  double margin;    // at the distance; nearer it is less [m]
  double interest;  // [m]

  void require_fits(const Tree&, Eigen::Index points) const override;
  ConstraintRows rows(const LookedAt& at) const override;
};

// The goal in a camera's view, or nearer than a distance.
struct GoalInView : PathRequirement {
  GraspSeen grasp;
  int carrier;       // the body that carries the camera
  Matrix3 rotation;  // of the camera in the frame of that
  Vector3 position;  // likewise
  Vector3 axis;      // of the view, unit length, in the camera's frame
  double half_angle, until;
  double margin;    // [rad]
  double interest;  // [rad, m]

  void require_fits(const Tree& tree, Eigen::Index points) const override;
  ConstraintRows rows(const LookedAt& at) const override;

 private:
  Pose camera_at(const Chain& chain, const Configuration& q) const;
};

}  // namespace ff

// The motion of a system whose joints are driven and that nothing pushes, with derivatives by what
// the joints' motion depends on. Half steps are the points and the times half-way between them.
#pragma once
#include "motion/base_turn.hpp"
#include "motion/end_conditions.hpp"

namespace ff {

// Where a system begins, and what stays of that.
struct Start {
  Vector3 position;         // of the base
  Matrix3 rotation;         // base to inertial axes
  Vector3 center;           // of mass
  Vector3 linear, angular;  // momentum, the latter about the centre of mass
  Base base;
};

class DrivenMotion {
 public:
  RowMajor q, v, q_half_way;  // a row a point; half-way between two

  // angles, rates, accelerations: of the joints, a row a half step.
  DrivenMotion(const Chain& chain, const Start& start, const RowMajor& angles,
               const RowMajor& rates, const RowMajor& accelerations, double duration);

  // What the motion misses of a goal.
  std::vector<double> goal_error(const Target& target) const;

  // Derivatives by the variables: of q, v and q half-way in the tangent space, a block of rows a
  // point, and of the goal error; `acceleration` is dv/dt itself, a row a point.
  struct Sensitivity {
    RowsToFill q, v, q_half_way, goal_error, acceleration;
  };

  // of_target: of the target, where the duration is one more variable.
  void sensitivity(const JointRows& rows, const Target& target, const TargetChange& of_target,
                   Sensitivity to) const;

 private:
  static std::vector<SystemMomentum> momenta(const Chain& chain, const RowMajor& angles, Base base);

  // The end effector at the last point.
  EndEffectorMotion end_effector() const;
  Conditions conditions(const Target& target, const EndEffectorMotion& tip,
                        const EndEffectorChange& by, const TargetChange& of_target) const;

  bool is_planar() const { return start_.base == Base::kPlanar; }
  const Matrix3& rotation_at(int point) const;
  const Vector3& rate_at(int point) const;
  Joints joint_rates(int half_step) const { return rates_.row(half_step); }
  Vector3 drift_at(int point) const { return rotation_at(point).transpose() * drift_; }

  // Position and quaternion of the base: the centre of mass moves uniformly, whatever the joints
  // do.
  Eigen::Matrix<double, 1, 7> place(int half_step, const Matrix3& rotation) const;
  Vector3 on_table(const Vector3& linear) const;

  using Block = Eigen::Block<RowsToFill, Eigen::Dynamic, Eigen::Dynamic, true>;

  // Derivatives of a configuration: the base's step in its own axes, its turn, and the joints.
  void write_step(const JointRows& rows, int half_step, const Matrix3& rotation,
                  const Matrix3X& turns, Block to) const;

  // Derivatives of a velocity.
  void write_change(const JointRows& rows, int point, const TurnDerivatives& of, Block to) const;

  // dv/dt:  d/dt (I omega + A theta') = -omega x R^T L, and likewise for P.
  Velocity acceleration(int point, const Columns6& by_joints) const;

  Start start_;
  RowMajor rates_, accelerations_;
  double duration_, step_;
  std::vector<SystemMomentum> momenta_;  // at the half steps
  BaseTurn turn_;
  Posture end_;
  double mass_;
  Vector3 drift_;  // velocity of the centre of mass, inertial axes
};

}  // namespace ff

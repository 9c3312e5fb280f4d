// How the base turns while its joints move and nothing pushes the system: steps of Runge-Kutta on
// the rotations, and their derivatives, exact as discretised.
//
// Half steps are the points of a motion and the times half-way between them, in order of time.
#pragma once
#include "kinematics/rotation.hpp"
#include "kinematics/system_momentum.hpp"
#include "motion/runge_kutta.hpp"

namespace ff {

// R with what turns it in a step.
struct TurnStep {
  Matrix3 rotation, half_way;      // base to inertial axes
  Stages<Vector3> turns;           // tangent steps
  Stages<Vector3> rates, momenta;  // in base axes
};

// Rows of the products of a matrix, or of the cross product of a vector, with derivatives that are
// stored by rows: from a matrix that is stored by columns Eigen would go entry by entry.
template <typename Columns>
auto product_row(const Matrix3& a, const Columns& b, int row) {
  return a(row, 0) * b.row(0) + (a(row, 1) * b.row(1) + a(row, 2) * b.row(2));
}
template <typename Columns>
auto cross_row(const Vector3& a, const Columns& b, int row) {
  const int next = (row + 1) % 3, last = (row + 2) % 3;
  return a[next] * b.row(last) - a[last] * b.row(next);
}

// SO(3), and how its tangent steps change by the variables, a column each.
struct Rotations {
  bool has_duration;  // in the last column
  double duration;

  static void add_bracket(Vector3& u, double weight, const Vector3& a, const Vector3& b);
  static void add_bracket_derivative(Matrix3X& du, double weight, const Vector3& a,
                                     const Matrix3X& da, const Vector3& b, const Matrix3X& db);
  void stretch(Matrix3X& du, const Vector3& u) const;
  void stretch(Matrix3X& du, const Vector3& u, double weight, const Vector3& a,
               const Vector3& b) const;
};

// Where a frame gets that turns by `by`, when it was turned by `turn` before and `by` changes.
struct Turning {
  Matrix3 back, of_by;

  explicit Turning(const Vector3& by) : back(turned_by(-by)), of_by(turned_by_derivative(by)) {}
  Matrix3X operator()(const Matrix3X& turn, const Matrix3X& change) const;
};

// How angles and rates change with the variables: those of the first joint come first, and those of
// each joint change it alone, and in the same way. The duration may be one more: it changes all
// joints, and how long a step is.
struct JointRows {
  Rows angles, rates, last_acceleration;  // by the variables of one joint, a row a half step
  int joints;
  // Of all joints; empty: the duration is given
  RowMajor angles_by_duration = {}, rates_by_duration = {}, last_acceleration_by_duration = {};

  int each() const { return static_cast<int>(angles.cols()); }
  int variables() const { return joints * each() + has_duration(); }
  bool has_duration() const { return angles_by_duration.size() > 0; }
  bool is_duration(int variable) const { return variable == joints * each(); }

  Joints of_last_accelerations(int variable) const;
  // Writes the derivatives of the angles, or of the rates, at a half step: a row a joint.
  template <typename Block>
  void write_angles(int half_step, Block to) const {
    write(angles, angles_by_duration, half_step, to);
  }
  template <typename Block>
  void write_rates(int half_step, Block to) const {
    write(rates, rates_by_duration, half_step, to);
  }
  // Subtracts the derivatives of what depends on angles, or on rates, as columns say, one a joint.
  template <typename Columns, typename Derivatives>
  void subtract_angles(const Columns& columns, int half_step, Derivatives&& from) const {
    subtract(columns, angles, angles_by_duration, half_step, from);
  }
  template <typename Columns, typename Derivatives>
  void subtract_rates(const Columns& columns, int half_step, Derivatives&& from) const {
    subtract(columns, rates, rates_by_duration, half_step, from);
  }

 private:
  template <typename Block>
  void write(const Rows& of_joint, const RowMajor& by_duration, int half_step, Block to) const {
    to.setZero();
    for (int j = 0; j < joints; ++j)
      to.row(j).segment(j * each(), each()) = of_joint.row(half_step);
    if (has_duration()) to.col(joints * each()) = by_duration.row(half_step).transpose();
  }
  template <typename Columns, typename Derivatives>
  void subtract(const Columns& columns, const Rows& of_joint, const RowMajor& by_duration,
                int half_step, Derivatives& from) const {
    for (int j = 0; j < joints; ++j)
      for (int axis = 0; axis < 3; ++axis)
        from.row(axis).segment(j * each(), each()) -= columns(axis, j) * of_joint.row(half_step);
    if (has_duration())
      from.col(joints * each()) -= columns * by_duration.row(half_step).transpose();
  }
};

class BaseTurn {
 public:
  std::vector<TurnStep> steps;
  Matrix3 rotation;        // at the last point
  Vector3 rate, momentum;  // there, in base axes

  // joint_rates: a row a half step; angular: L about the centre of mass, inertial axes.
  BaseTurn(const std::vector<SystemMomentum>& at, const RowMajor& joint_rates, const Matrix3& start,
           const Vector3& angular, double step);

 private:
  // Eq. (27)
  static Vector3 base_rate(const SystemMomentum& at, const Vector3& momentum, const Joints& rates);
};

// Derivatives of a base's turn by the variables, a column each.
struct TurnDerivatives {
  std::vector<Matrix3X> turns, half_way;  // of the attitude, in its own axes, at and between points
  std::vector<Matrix3X> rates;            // of the base's rate, at the points
  std::vector<Columns6> by_joints;        // of both momenta at fixed velocities, at the points

  // is_held: wheels hold the base's attitude, which nothing changes.
  TurnDerivatives(const BaseTurn& base, const std::vector<SystemMomentum>& at,
                  const RowMajor& joint_rates, const JointRows& rows, double step, double duration,
                  bool is_held);

 private:
  // Of the base's rate, Eq. (27).
  static Matrix3X change(const SystemMomentum& at, const Matrix6J& by_joints,
                         const Vector3& momentum, const Matrix3X& turn, const JointRows& rows,
                         int half_step);
};

}  // namespace ff

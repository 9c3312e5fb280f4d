// What a motion misses of its goal: pose, twist and acceleration of the end effector, or a part.
#pragma once
#include "end_effector_motion.hpp"
#include "rotation.hpp"

namespace ff {

enum class Orientation { kFixed, kAboutAxis, kFree };

struct Target {
  Vector3 position;
  Matrix3 rotation;  // to inertial axes
  Vector6 twist, acceleration;
  Orientation orientation;
  Vector3 free_axis;                      // of the end effector, about which it may turn
  Eigen::Matrix<double, 2, 3> across;     // its axes across that one
};

// Values, and their derivatives along directions, a column each.
struct Conditions {
  Eigen::VectorXd values;
  Eigen::MatrixXd by;

  // Appends matrix * value.
  template <typename Rows>
  void add(const Rows& rows, const Vector3& value, const Matrix3X& value_by) {
    const auto before = values.size();
    values.conservativeResize(before + rows.rows());
    by.conservativeResize(before + rows.rows(), value_by.cols());
    values.tail(rows.rows()) = rows * value;
    by.bottomRows(rows.rows()) = rows * value_by;
  }
};

using Rows = Eigen::Matrix<double, Eigen::Dynamic, 3>;

// By what turn about the axes across the free one that axis misses the target's [rad].
inline void add_axis_error(const Target& target, const EndEffectorMotion& tip, Conditions& to) {
  const Vector3& axis = target.free_axis;
  const Vector3 there = tip.rotation.transpose() * target.rotation * axis;
  const Matrix3X there_by = skew(there) * tip.way.bottomRows<3>();
  const double aligned = 1e-9;  // its cosine is one but for rounding: series replace quotients
  const double cosine = std::min(std::max(axis.dot(there), -1 + aligned), 1 - aligned);
  const double beyond = 1 - cosine, square = 1 - cosine * cosine;
  double part, slope;  // the angle over its sine, and its derivative by the cosine
  if (beyond < 1.5 * aligned)
    part = 1 + beyond / 3, slope = -1. / 3;
  else
    part = std::acos(cosine) / std::sqrt(square), slope = (cosine * part - 1) / square;
  const Vector3 sines = axis.cross(there);
  const Eigen::RowVectorXd cosine_by = axis.transpose() * there_by;
  to.add(target.across, part * sines, part * skew(axis) * there_by + slope * sines * cosine_by);
}

// Pose first, then twist and acceleration: lengths [m] and angles [rad], those of the last two being
// the way that they make in a quarter of the duration.
inline Conditions end_conditions(const Target& target, const EndEffectorMotion& tip, double duration,
                                 bool planar) {
  const Rows linear = planar ? Rows(Matrix3::Identity().topRows<2>()) : Rows(Matrix3::Identity());
  const Rows angular = planar ? Rows(Matrix3::Identity().bottomRows<1>()) : Rows(Matrix3::Identity());
  const Matrix3X turn = tip.way.bottomRows<3>();
  Conditions found;
  found.add(linear, tip.position - target.position, tip.rotation * tip.way.topRows<3>());
  if (target.orientation == Orientation::kFixed) {
    // In the target's axes, where it is the same vector as in the end effector's.
    const Vector3 off = turn_of(target.rotation.transpose() * tip.rotation);
    const Rows rows = planar ? Rows(target.rotation.bottomRows<1>()) : Rows(Matrix3::Identity());
    found.add(rows, off, turn_of_derivative(off) * turn);
  } else if (target.orientation == Orientation::kAboutAxis) {
    add_axis_error(target, tip, found);
  }
  const auto add_rates = [&](double unit, const Vector6& in_ee, const Matrix6X& in_ee_by,
                             const Vector6& wanted) {
    const Matrix3& R = tip.rotation;
    const Vector3 moving = in_ee.head<3>(), turning = in_ee.tail<3>();
    found.add(unit * linear, R * moving - wanted.head<3>(),
              R * (in_ee_by.topRows<3>() - skew(moving) * turn));
    if (target.orientation == Orientation::kFixed) {
      found.add(unit * angular, R * turning - wanted.tail<3>(),
                R * (in_ee_by.bottomRows<3>() - skew(turning) * turn));
    } else if (target.orientation == Orientation::kAboutAxis) {
      // In the end effector's axes the wanted turn turns with them.
      const Vector3 wanted_in_ee = R.transpose() * wanted.tail<3>();
      found.add(unit * target.across, turning - wanted_in_ee,
                in_ee_by.bottomRows<3>() - skew(wanted_in_ee) * turn);
    }
  };
  const double quarter = duration / 4;
  add_rates(quarter, tip.twist, tip.twist_by, target.twist);
  add_rates(quarter * quarter, tip.acceleration, tip.acceleration_by, target.acceleration);
  return found;
}

}  // namespace ff

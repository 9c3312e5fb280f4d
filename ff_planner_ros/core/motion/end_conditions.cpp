#include "motion/end_conditions.hpp"

namespace ff {

void Conditions::add(const Directions& axes, double unit, const Changing& vector,
                     double unit_change) {
  for (const Vector3& axis : axes) {
    values.push_back(unit * axis.dot(vector.value));
    changes.push_back(unit * axis.dot(vector.change) + unit_change * axis.dot(vector.value));
  }
}

Changing axis_error(const Target& target, const Matrix3& rotation, const Vector3& turn) {
  const Vector3& axis = target.free_axis;
  const Vector3 there = rotation.transpose() * target.rotation * axis;
  const Vector3 there_by = there.cross(turn);
  const double aligned = 1e-9;  // its cosine is one but for rounding: series replace quotients
  const double cosine = std::min(std::max(axis.dot(there), -1 + aligned), 1 - aligned);
  const double beyond = 1 - cosine, square = 1 - cosine * cosine;
  double part, slope;  // the angle over its sine, and its derivative by the cosine
  if (beyond < 1.5 * aligned) {
    part = 1 + beyond / 3;
    slope = -1. / 3;
  } else {
    part = std::acos(cosine) / std::sqrt(square);
    slope = (cosine * part - 1) / square;
  }
  const Vector3 sines = axis.cross(there);
  return {part * sines, part * axis.cross(there_by) + slope * axis.dot(there_by) * sines};
}

Conditions end_conditions(const Target& target, const EndEffectorMotion& tip,
                          const EndEffectorChange& by, const TargetChange& of_target,
                          double duration, bool planar) {
  // Made once: the conditions are asked for along every variable.
  static const Directions all{Vector3::UnitX(), Vector3::UnitY(), Vector3::UnitZ()},
      in_plane{Vector3::UnitX(), Vector3::UnitY()}, about_normal{Vector3::UnitZ()};
  const Directions &linear = planar ? in_plane : all, &angular = planar ? about_normal : all;
  const Matrix3& R = tip.rotation;
  const Vector3 turn = by.way.tail<3>();
  const Vector3 off_turn = turn - R.transpose() * of_target.way.tail<3>();  // seen from the target
  Conditions found;
  found.values.reserve(18);
  found.changes.reserve(18);
  found.add(linear, 1,
            {tip.position - target.position, R * by.way.head<3>() - of_target.way.head<3>()});
  if (target.orientation == Orientation::kFixed) {
    // In the target's axes, where it is the same vector as in the end effector's.
    const Vector3 off = turn_of(target.rotation.transpose() * R);
    const Changing missed{off, turn_of_derivative(off) * off_turn};
    found.add(planar ? Directions{target.rotation.row(2)} : all, 1, missed);
  } else if (target.orientation == Orientation::kAboutAxis) {
    found.add(target.across, 1, axis_error(target, R, off_turn));
  }
  const auto add = [&](double unit, double unit_change, const Vector6& in_ee, const Vector6& change,
                       const Vector6& wanted, const Vector6& wanted_change) {
    const auto missed = [&](const Vector3& value, const Vector3& its_change, const Vector3& goal,
                            const Vector3& goal_change) {
      return Changing{R * value - goal, R * (its_change - value.cross(turn)) - goal_change};
    };
    found.add(linear, unit,
              missed(in_ee.head<3>(), change.head<3>(), wanted.head<3>(), wanted_change.head<3>()),
              unit_change);
    if (target.orientation == Orientation::kFixed) {
      found.add(
          angular, unit,
          missed(in_ee.tail<3>(), change.tail<3>(), wanted.tail<3>(), wanted_change.tail<3>()),
          unit_change);
    } else if (target.orientation == Orientation::kAboutAxis) {
      // What is wanted turns against the end effector's axes.
      const Vector3 goal = R.transpose() * wanted.tail<3>();
      const Vector3 goal_change = goal.cross(turn) + R.transpose() * wanted_change.tail<3>();
      found.add(target.across, unit, {in_ee.tail<3>() - goal, change.tail<3>() - goal_change},
                unit_change);
    }
  };
  const double quarter = duration / 4, longer = of_target.duration / 4;
  add(quarter, longer, tip.twist, by.twist, target.twist, of_target.twist);
  add(quarter * quarter, 2 * quarter * longer, tip.acceleration, by.acceleration,
      target.acceleration, of_target.acceleration);
  return found;
}

}  // namespace ff

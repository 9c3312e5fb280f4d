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

// SO(3), and how its tangent steps change by a variable.
struct Rotations {
  bool is_duration;
  double duration;

  static void add_bracket(Vector3& u, double weight, const Vector3& a, const Vector3& b) {
    u += weight * a.cross(b);
  }
  static void add_bracket_derivative(Vector3& du, double weight, const Vector3& a,
                                     const Vector3& da, const Vector3& b, const Vector3& db) {
    du += weight * (a.cross(db) - b.cross(da));
  }
  void stretch(Vector3& du, const Vector3& u) const {
    if (is_duration) du += u / duration;
  }
  void stretch(Vector3& du, const Vector3& u, double weight, const Vector3& a,
               const Vector3& b) const {
    if (is_duration) du += (u + weight * a.cross(b)) / duration;
  }
};

// Where a frame gets that turns by `by`, when it was turned by `turn` before and `by` changes.
struct Turning {
  Matrix3 back, of_by;

  explicit Turning(const Vector3& by) : back(turned_by(-by)), of_by(turned_by_derivative(by)) {}
  Vector3 operator()(const Vector3& turn, const Vector3& change) const {
    return back * turn + of_by * change;
  }
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

  // Of the angles, or of the rates, at a half step by a variable.
  Joints of_angles(int half_step, int variable) const {
    return change(angles, angles_by_duration, half_step, variable);
  }
  Joints of_rates(int half_step, int variable) const {
    return change(rates, rates_by_duration, half_step, variable);
  }
  Joints of_last_accelerations(int variable) const {
    return change(last_acceleration, last_acceleration_by_duration, 0, variable);
  }
  // Of what depends on angles, or on rates, as columns say, one a joint.
  template <typename Columns>
  Vector3 along_angles(const Columns& columns, int half_step, int variable) const {
    return along(columns, angles, angles_by_duration, half_step, variable);
  }
  template <typename Columns>
  Vector3 along_rates(const Columns& columns, int half_step, int variable) const {
    return along(columns, rates, rates_by_duration, half_step, variable);
  }

 private:
  Joints change(const Rows& of_joint, const RowMajor& by_duration, int half_step,
                int variable) const {
    if (is_duration(variable)) return by_duration.row(half_step);
    Joints changed = Joints::Zero(joints);
    changed[variable / each()] = of_joint(half_step, variable % each());
    return changed;
  }
  template <typename Columns>
  Vector3 along(const Columns& columns, const Rows& of_joint, const RowMajor& by_duration,
                int half_step, int variable) const {
    if (is_duration(variable)) return columns * by_duration.row(half_step).transpose();
    return columns.col(variable / each()) * of_joint(half_step, variable % each());
  }
};

class BaseTurn {
 public:
  std::vector<TurnStep> steps;
  Matrix3 rotation;        // at the last point
  Vector3 rate, momentum;  // there, in base axes

  // joint_rates: a row a half step; angular: L about the centre of mass, inertial axes.
  BaseTurn(const std::vector<SystemMomentum>& at, const RowMajor& joint_rates, const Matrix3& start,
           const Vector3& angular, double step)
      : rotation(start) {
    for (size_t i = 0; i + 1 < at.size(); i += 2) {
      TurnStep now;
      now.rotation = rotation;
      for (int stage = 0; stage < 4; ++stage) {
        const size_t half_step = i + kHalfSteps[stage];
        now.momenta[stage] = rotation.transpose() * angular;
        now.rates[stage] = base_rate(at[half_step], now.momenta[stage], joint_rates.row(half_step));
        now.turns[stage] = tangent_step<Rotations>(stage, step, now.rates);
        rotation = now.rotation * turned_by(now.turns[stage]);
      }
      now.half_way = now.rotation * turned_by(half_way(now.turns));
      steps.push_back(now);
    }
    momentum = rotation.transpose() * angular;
    rate = base_rate(at.back(), momentum, joint_rates.row(joint_rates.rows() - 1));
  }

 private:
  // Eq. (27)
  static Vector3 base_rate(const SystemMomentum& at, const Vector3& momentum, const Joints& rates) {
    return at.to_rate * (momentum - at.coupling * rates);
  }
};

// Derivatives of a base's turn by the variables, a column each.
struct TurnDerivatives {
  std::vector<Columns3> turns, half_way;  // of the attitude, in its own axes, at and between points
  std::vector<Columns3> rates;            // of the base's rate, at the points
  std::vector<Columns6> by_joints;        // of both momenta at fixed velocities, at the points

  TurnDerivatives(const BaseTurn& base, const std::vector<SystemMomentum>& at,
                  const RowMajor& joint_rates, const JointRows& rows, double step,
                  double duration) {
    const int variables = rows.variables();
    turns.push_back(Columns3::Zero(3, variables));
    const auto by_joints_at = [&](int half_step, const Vector3& base_rate) {
      return at[half_step].by_joints(base_rate, joint_rates.row(half_step));
    };
    for (const TurnStep& now : base.steps) {
      const int i = 2 * static_cast<int>(half_way.size());
      const Turning to_middle(ff::half_way(now.turns));
      std::vector<Turning> to_next;
      Stages<Columns6> by;
      for (int stage = 0; stage < 4; ++stage) {
        to_next.emplace_back(now.turns[stage]);
        by[stage] = by_joints_at(i + kHalfSteps[stage], now.rates[stage]);
      }
      Columns3 first_rates(3, variables), middle(3, variables), next(3, variables);
      for (int x = 0; x < variables; ++x) {
        const Rotations rotations{rows.is_duration(x), duration};
        const Vector3 begin = turns.back().col(x);
        Vector3 turn = begin;
        Stages<Vector3> d, du;
        for (int stage = 0; stage < 4; ++stage) {
          const int half_step = i + kHalfSteps[stage];
          d[stage] = change(at[half_step], by[stage], now.momenta[stage], turn, rows, half_step, x);
          du[stage] =
              tangent_step_derivative(rotations, stage, step, now.rates, now.turns[stage], d);
          turn = to_next[stage](begin, du[stage]);
        }
        first_rates.col(x) = d[0];
        middle.col(x) = to_middle(begin, ff::half_way(du));
        next.col(x) = turn;
      }
      rates.push_back(first_rates);
      by_joints.push_back(by[0]);
      half_way.push_back(middle);
      turns.push_back(next);
    }
    const int last = static_cast<int>(at.size()) - 1;
    by_joints.push_back(by_joints_at(last, base.rate));
    rates.emplace_back(3, variables);
    for (int x = 0; x < variables; ++x)
      rates.back().col(x) =
          change(at[last], by_joints.back(), base.momentum, turns.back().col(x), rows, last, x);
  }

 private:
  // Of the base's rate, Eq. (27), by one variable.
  static Vector3 change(const SystemMomentum& at, const Columns6& by_joints,
                        const Vector3& momentum, const Vector3& turn, const JointRows& rows,
                        int half_step, int variable) {
    return at.to_rate * (momentum.cross(turn) -
                         rows.along_angles(by_joints.bottomRows<3>(), half_step, variable) -
                         rows.along_rates(at.coupling, half_step, variable));
  }
};

}  // namespace ff

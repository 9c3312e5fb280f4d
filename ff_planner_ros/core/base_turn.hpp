// How the base turns while its joints move and nothing pushes the system: steps of Runge-Kutta of
// order four on the rotations, and their derivatives, exact as discretised.
//
// Half steps are the points of a motion and the times half-way between them, in order of time. The
// stages of a step lie at 0, 1/2, 1/2 and 1 of it.
#pragma once
#include "rotation.hpp"
#include "system_momentum.hpp"

namespace ff {

// R with what turns it in a step.
struct TurnStep {
  Matrix3 rotation, half_way;             // base to inertial axes
  std::array<Vector3, 4> increments;      // turns to the stages; the last is the whole step
  std::array<Vector3, 4> rates, momenta;  // at the stages, in base axes

  Vector3 to_half_way() const { return (increments[0] + increments[1]) / 2; }
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
  Eigen::Map<const RowMajor> angles, rates;  // by the variables of one joint, a row a half step
  int joints;
  RowMajor angles_by_duration, rates_by_duration;  // of all joints; empty: it is given

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
  using Rows = Eigen::Map<const RowMajor>;

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
    const double h = step;
    for (size_t i = 0; i + 1 < at.size(); i += 2) {
      TurnStep now;
      auto& [u1, u2, u3, whole] = now.increments;
      auto& [v1, v2, v3, v4] = now.rates;
      const auto stage = [&](int k, size_t half_step, const Matrix3& attitude) {
        now.momenta[k] = attitude.transpose() * angular;
        now.rates[k] = base_rate(at[half_step], now.momenta[k], joint_rates.row(half_step));
      };
      now.rotation = rotation;
      stage(0, i, rotation);
      u1 = h / 2 * v1;
      stage(1, i + 1, rotation * turned_by(u1));
      u2 = h / 2 * v2 + h * h / 8 * v1.cross(v2);
      stage(2, i + 1, rotation * turned_by(u2));
      u3 = h * v3;
      stage(3, i + 2, rotation * turned_by(u3));
      whole = h / 6 * (v1 + 2 * v2 + 2 * v3 + v4) + h * h / 12 * v1.cross(v4);
      now.half_way = rotation * turned_by(now.to_half_way());
      rotation = rotation * turned_by(whole);
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
    const double h = step;
    const int variables = rows.variables();
    turns.push_back(Columns3::Zero(3, variables));
    const auto by_joints_at = [&](int half_step, const Vector3& base_rate) {
      return at[half_step].by_joints(base_rate, joint_rates.row(half_step));
    };
    for (const TurnStep& now : base.steps) {
      const int i = 2 * static_cast<int>(half_way.size());
      const auto& [u1, u2, u3, whole] = now.increments;
      const auto& [v1, v2, v3, v4] = now.rates;
      const Turning to_2(u1), to_3(u2), to_4(u3), to_middle(now.to_half_way()), to_next(whole);
      const Columns6 by_1 = by_joints_at(i, v1), by_2 = by_joints_at(i + 1, v2);
      const Columns6 by_3 = by_joints_at(i + 1, v3), by_4 = by_joints_at(i + 2, v4);
      Columns3 first_rates(3, variables), middle(3, variables), next(3, variables);
      for (int x = 0; x < variables; ++x) {
        const auto of_rate = [&](int half_step, const Columns6& by, int stage,
                                 const Vector3& turn) {
          return change(at[half_step], by, now.momenta[stage], turn, rows, half_step, x);
        };
        const Vector3 turn = turns.back().col(x);
        // A step is a part of the duration: what is of order h^k in it grows by k / T of itself.
        const bool longer = rows.is_duration(x);
        const Vector3 d1 = of_rate(i, by_1, 0, turn);
        Vector3 du1 = h / 2 * d1;
        if (longer) du1 += u1 / duration;
        const Vector3 d2 = of_rate(i + 1, by_2, 1, to_2(turn, du1));
        Vector3 du2 = h / 2 * d2 + h * h / 8 * (v1.cross(d2) - v2.cross(d1));
        if (longer) du2 += (u2 + h * h / 8 * v1.cross(v2)) / duration;
        const Vector3 d3 = of_rate(i + 1, by_3, 2, to_3(turn, du2));
        Vector3 du3 = h * d3;
        if (longer) du3 += u3 / duration;
        const Vector3 d4 = of_rate(i + 2, by_4, 3, to_4(turn, du3));
        Vector3 of_whole =
            h / 6 * (d1 + 2 * d2 + 2 * d3 + d4) + h * h / 12 * (v1.cross(d4) - v4.cross(d1));
        if (longer) of_whole += (whole + h * h / 12 * v1.cross(v4)) / duration;
        first_rates.col(x) = d1;
        middle.col(x) = to_middle(turn, (du1 + du2) / 2);
        next.col(x) = to_next(turn, of_whole);
      }
      rates.push_back(first_rates), by_joints.push_back(by_1);
      half_way.push_back(middle), turns.push_back(next);
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

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

// How the joints' angles and rates change with the variables: the variables of the first joint come
// first, and those of each joint change it in the same way.
struct JointRows {
  Eigen::Map<const RowMajor> angles, rates;  // a row a half step
  int joints;

  int variables() const { return joints * static_cast<int>(angles.cols()); }

  // Adds  of_angles d(theta) + of_rates d(theta')  at a half step.
  template <typename OfAngles, typename OfRates, typename Sum>
  void add(int half_step, const OfAngles& of_angles, const OfRates& of_rates, Sum&& sum) const {
    const int each = static_cast<int>(angles.cols());
    for (int j = 0; j < joints; ++j)
      sum.middleCols(j * each, each) +=
          of_angles.col(j) * angles.row(half_step) + of_rates.col(j) * rates.row(half_step);
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
  std::vector<Matrix3X> turns, half_way;  // of the attitude, in its own axes, at and between points
  std::vector<Matrix3X> rates;            // of the base's rate, at the points
  std::vector<Matrix6X> by_joints;        // of both momenta at fixed velocities, at the points

  TurnDerivatives(const BaseTurn& base, const std::vector<SystemMomentum>& at,
                  const RowMajor& joint_rates, const JointRows& rows, double step) {
    const double h = step;
    Matrix3X turn = Matrix3X::Zero(3, rows.variables());
    const auto of_rate = [&](int half_step, const Matrix6X& by_joints, const Vector3& momentum,
                             const Matrix3X& turned) -> Matrix3X {
      Matrix3X change = Matrix3X::Zero(3, turned.cols());
      rows.add(half_step, by_joints.bottomRows<3>(), at[half_step].coupling, change);
      return at[half_step].to_rate * (skew(momentum) * turned - change);
    };
    const auto by_joints_at = [&](int half_step, const Vector3& base_rate) {
      return at[half_step].by_joints(base_rate, joint_rates.row(half_step));
    };
    const auto turned = [&](const Vector3& by, const Matrix3X& of_by) -> Matrix3X {
      return turned_by(-by) * turn + turned_by_derivative(by) * of_by;
    };
    for (size_t point = 0; point < base.steps.size(); ++point) {
      const TurnStep& now = base.steps[point];
      const int i = 2 * static_cast<int>(point);
      const auto& [u1, u2, u3, whole] = now.increments;
      const auto& [v1, v2, v3, v4] = now.rates;
      turns.push_back(turn);
      by_joints.push_back(by_joints_at(i, v1));
      const Matrix3X d1 = of_rate(i, by_joints.back(), now.momenta[0], turn);
      rates.push_back(d1);
      const Matrix3X du1 = h / 2 * d1;
      const Matrix3X d2 = of_rate(i + 1, by_joints_at(i + 1, v2), now.momenta[1], turned(u1, du1));
      const Matrix3X du2 = h / 2 * d2 + h * h / 8 * (skew(v1) * d2 - skew(v2) * d1);
      const Matrix3X d3 = of_rate(i + 1, by_joints_at(i + 1, v3), now.momenta[2], turned(u2, du2));
      const Matrix3X d4 = of_rate(i + 2, by_joints_at(i + 2, v4), now.momenta[3],
                                  turned(u3, h * d3));
      const Matrix3X of_whole = h / 6 * (d1 + 2 * d2 + 2 * d3 + d4) +
                                h * h / 12 * (skew(v1) * d4 - skew(v4) * d1);
      half_way.push_back(turned(now.to_half_way(), (du1 + du2) / 2));
      turn = turned(whole, of_whole);
    }
    turns.push_back(turn);
    const int last = static_cast<int>(at.size()) - 1;
    by_joints.push_back(by_joints_at(last, base.rate));
    rates.push_back(of_rate(last, by_joints.back(), base.momentum, turn));
  }
};

}  // namespace ff

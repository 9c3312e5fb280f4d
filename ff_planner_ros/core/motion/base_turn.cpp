#include "motion/base_turn.hpp"

namespace ff {

void Rotations::add_bracket(Vector3& u, double weight, const Vector3& a, const Vector3& b) {
  u += weight * a.cross(b);
}

void Rotations::add_bracket_derivative(Matrix3X& du, double weight, const Vector3& a,
                                       const Matrix3X& da, const Vector3& b, const Matrix3X& db) {
  for (int row = 0; row < 3; ++row)
    du.row(row) += weight * (cross_row(a, db, row) - cross_row(b, da, row));
}

void Rotations::stretch(Matrix3X& du, const Vector3& u) const {
  if (has_duration) du.col(du.cols() - 1) += u / duration;
}

void Rotations::stretch(Matrix3X& du, const Vector3& u, double weight, const Vector3& a,
                        const Vector3& b) const {
  if (has_duration) du.col(du.cols() - 1) += (u + weight * a.cross(b)) / duration;
}

Matrix3X Turning::operator()(const Matrix3X& turn, const Matrix3X& change) const {
  Matrix3X turned(3, turn.cols());
  for (int row = 0; row < 3; ++row)
    turned.row(row) = product_row(back, turn, row) + product_row(of_by, change, row);
  return turned;
}

Joints JointRows::of_last_accelerations(int variable) const {
  if (is_duration(variable)) return last_acceleration_by_duration.row(0);
  Joints changed = Joints::Zero(joints);
  changed[variable / each()] = last_acceleration(0, variable % each());
  return changed;
}

BaseTurn::BaseTurn(const std::vector<SystemMomentum>& at, const RowMajor& joint_rates,
                   const Matrix3& start, const Vector3& angular, double step)
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

Vector3 BaseTurn::base_rate(const SystemMomentum& at, const Vector3& momentum,
                            const Joints& rates) {
  return at.to_rate * (momentum - at.coupling * rates);
}

TurnDerivatives::TurnDerivatives(const BaseTurn& base, const std::vector<SystemMomentum>& at,
                                 const RowMajor& joint_rates, const JointRows& rows, double step,
                                 double duration, bool is_held) {
  const Rotations rotations{rows.has_duration(), duration};
  const auto by_joints_at = [&](int half_step, const Vector3& base_rate) {
    return at[half_step].by_joints(base_rate, joint_rates.row(half_step));
  };
  const Matrix3X unchanged = Matrix3X::Zero(3, rows.variables());
  if (is_held) {
    half_way.assign(base.steps.size(), unchanged);
    turns.assign(base.steps.size() + 1, unchanged);
    rates = turns;
    for (size_t i = 0; i < at.size(); i += 2)
      by_joints.push_back(by_joints_at(static_cast<int>(i), Vector3::Zero()));
    return;
  }
  turns.push_back(unchanged);
  for (const TurnStep& now : base.steps) {
    const int i = 2 * static_cast<int>(half_way.size());
    const Matrix3X& begin = turns.back();
    Matrix3X turn = begin;
    Stages<Matrix3X> d, du;
    for (int stage = 0; stage < 4; ++stage) {
      const int half_step = i + kHalfSteps[stage];
      const Matrix6J by = by_joints_at(half_step, now.rates[stage]);
      d[stage] = change(at[half_step], by, now.momenta[stage], turn, rows, half_step);
      du[stage] = tangent_step_derivative(rotations, stage, step, now.rates, now.turns[stage], d);
      turn = Turning(now.turns[stage])(begin, du[stage]);
      if (stage == 0) by_joints.push_back(by);
    }
    half_way.push_back(Turning(ff::half_way(now.turns))(begin, ff::half_way(du)));
    rates.push_back(std::move(d[0]));
    turns.push_back(std::move(turn));
  }
  const int last = static_cast<int>(at.size()) - 1;
  by_joints.push_back(by_joints_at(last, base.rate));
  rates.push_back(change(at[last], by_joints.back(), base.momentum, turns.back(), rows, last));
}

Matrix3X TurnDerivatives::change(const SystemMomentum& at, const Matrix6J& by_joints,
                                 const Vector3& momentum, const Matrix3X& turn,
                                 const JointRows& rows, int half_step) {
  Matrix3X of_momentum(3, turn.cols()), of_rate(3, turn.cols());
  for (int row = 0; row < 3; ++row) of_momentum.row(row) = cross_row(momentum, turn, row);
  rows.subtract_angles(by_joints.bottomRows<3>(), half_step, of_momentum);
  rows.subtract_rates(at.coupling, half_step, of_momentum);
  for (int row = 0; row < 3; ++row) of_rate.row(row) = product_row(at.to_rate, of_momentum, row);
  return of_rate;
}

}  // namespace ff

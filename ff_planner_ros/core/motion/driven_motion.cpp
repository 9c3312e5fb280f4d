#include "motion/driven_motion.hpp"

#include "kinematics/deadline.hpp"

namespace ff {

DrivenMotion::DrivenMotion(const Chain& chain, const Start& start, const RowMajor& angles,
                           const RowMajor& rates, const RowMajor& accelerations, double duration)
    : start_(start),
      rates_(rates),
      accelerations_(accelerations),
      duration_(duration),
      step_(2 * duration / static_cast<double>(angles.rows() - 1)),
      momenta_(momenta(chain, angles, start.base)),
      turn_(momenta_, rates, start.rotation, start.angular, step_),
      end_(chain, angles.row(angles.rows() - 1)),
      mass_(end_.composite[0].mass),
      drift_(start.linear / mass_) {
  const int n = chain.joints(), points = static_cast<int>(turn_.steps.size()) + 1;
  q.resize(points, 7 + n);
  v.resize(points, 6 + n);
  q_half_way.resize(points - 1, 7 + n);
  for (int i = 0; i < points; ++i) {
    const SystemMomentum& at = momenta_[2 * i];
    const Vector3 rate = rate_at(i), drift = drift_at(i);
    q.row(i) << place(2 * i, rotation_at(i)), angles.row(2 * i);
    // The centre of mass drifts:  v = R^T P / m - omega x c - dc/dtheta theta'
    const Vector3 linear = drift - rate.cross(at.center) - at.of_center * joint_rates(2 * i);
    v.row(i) << on_table(linear).transpose(), rate.transpose(), rates.row(2 * i);
    if (i + 1 < points)
      q_half_way.row(i) << place(2 * i + 1, turn_.steps[i].half_way), angles.row(2 * i + 1);
  }
}

std::vector<double> DrivenMotion::goal_error(const Target& target) const {
  return conditions(target, end_effector(), EndEffectorChange(), TargetChange()).values;
}

void DrivenMotion::sensitivity(const JointRows& rows, const Target& target,
                               const TargetChange& of_target, Sensitivity to) const {
  const int n = static_cast<int>(rates_.cols()), variables = rows.variables(), size = 6 + n;
  const int points = static_cast<int>(turn_.steps.size()) + 1;
  const TurnDerivatives of(turn_, momenta_, rates_, rows, step_, duration_,
                           start_.base == Base::kHeld);
  for (int i = 0; i < points; ++i) {
    Deadline::require();
    write_step(rows, 2 * i, rotation_at(i), of.turns[i], to.q.middleRows(i * size, size));
    if (i + 1 < points)
      write_step(rows, 2 * i + 1, turn_.steps[i].half_way, of.half_way[i],
                 to.q_half_way.middleRows(i * size, size));
    write_change(rows, i, of, to.v.middleRows(i * size, size));
    to.acceleration.row(i) = acceleration(i, of.by_joints[i]);
  }
  const EndEffectorMotion tip = end_effector();
  const EndEffectorDerivatives of_tip = tip.derivatives();
  const auto dq = to.q.bottomRows(size), dv = to.v.bottomRows(size);
  for (int x = 0; x < variables; ++x) {
    const StateChange change{dq.col(x).head<6>(), dv.col(x).head<6>(), dq.col(x).tail(n),
                             dv.col(x).tail(n), rows.of_last_accelerations(x)};
    const TargetChange moved = rows.is_duration(x) ? of_target : TargetChange();
    const std::vector<double> changes =
        conditions(target, tip, of_tip.along(change), moved).changes;
    to.goal_error.col(x) = Values(changes.data(), changes.size());
  }
}

std::vector<SystemMomentum> DrivenMotion::momenta(const Chain& chain, const RowMajor& angles,
                                                  Base base) {
  std::vector<SystemMomentum> found;
  found.reserve(angles.rows());
  for (int i = 0; i < angles.rows(); ++i) {
    Deadline::require();
    found.emplace_back(Posture(chain, angles.row(i)), base);
  }
  return found;
}

EndEffectorMotion DrivenMotion::end_effector() const {
  const auto last = q.rows() - 1, n = rates_.cols();
  return {end_,
          {q.row(last).head<3>(), turn_.rotation, v.row(last).head<6>(), v.row(last).tail(n),
           accelerations_.row(accelerations_.rows() - 1)},
          start_.base};
}

Conditions DrivenMotion::conditions(const Target& target, const EndEffectorMotion& tip,
                                    const EndEffectorChange& by,
                                    const TargetChange& of_target) const {
  return end_conditions(target, tip, by, of_target, duration_, is_planar());
}

const Matrix3& DrivenMotion::rotation_at(int point) const {
  return point < static_cast<int>(turn_.steps.size()) ? turn_.steps[point].rotation
                                                      : turn_.rotation;
}

const Vector3& DrivenMotion::rate_at(int point) const {
  return point < static_cast<int>(turn_.steps.size()) ? turn_.steps[point].rates[0] : turn_.rate;
}

Eigen::Matrix<double, 1, 7> DrivenMotion::place(int half_step, const Matrix3& rotation) const {
  Vector3 position = start_.center + half_step * step_ / 2 * drift_;
  position -= rotation * momenta_[half_step].center;
  // The table takes up what an axis is off its normal.
  if (is_planar()) position.z() = start_.position.z();
  Eigen::Matrix<double, 1, 7> row;
  row << position.transpose(), quaternion_xyzw(rotation).transpose();
  return row;
}

Vector3 DrivenMotion::on_table(const Vector3& linear) const {
  return is_planar() ? Vector3(linear.x(), linear.y(), 0) : linear;
}

void DrivenMotion::write_step(const JointRows& rows, int half_step, const Matrix3& rotation,
                              const Matrix3X& turns, Block to) const {
  const SystemMomentum& at = momenta_[half_step];
  auto way = to.topRows<3>();
  for (int row = 0; row < 3; ++row) way.row(row) = cross_row(at.center, turns, row);
  rows.subtract_angles(at.of_center, half_step, way);
  // The centre of mass drifts for longer.
  if (rows.has_duration())
    way.col(way.cols() - 1) +=
        half_step * step_ / (2 * duration_) * (rotation.transpose() * drift_);
  if (is_planar()) way.row(2).setZero();
  to.middleRows<3>(3) = turns;
  rows.write_angles(half_step, to.bottomRows(to.rows() - 6));
}

void DrivenMotion::write_change(const JointRows& rows, int point, const TurnDerivatives& of,
                                Block to) const {
  const SystemMomentum& at = momenta_[2 * point];
  const Vector3 drift = drift_at(point);
  const Matrix3J of_momentum = of.by_joints[point].topRows<3>() / mass_;
  auto linear = to.topRows<3>();
  for (int row = 0; row < 3; ++row)
    linear.row(row) =
        cross_row(drift, of.turns[point], row) + cross_row(at.center, of.rates[point], row);
  rows.subtract_angles(of_momentum, 2 * point, linear);
  rows.subtract_rates(at.of_center, 2 * point, linear);
  if (is_planar()) linear.row(2).setZero();
  to.middleRows<3>(3) = of.rates[point];
  rows.write_rates(2 * point, to.bottomRows(to.rows() - 6));
}

Velocity DrivenMotion::acceleration(int point, const Columns6& by_joints) const {
  const SystemMomentum& at = momenta_[2 * point];
  const Vector3 rate = rate_at(point), drift = drift_at(point);
  const Vector3 momentum = rotation_at(point).transpose() * start_.angular;
  const Joints accelerated = accelerations_.row(2 * point);
  const Vector6 moving = by_joints * joint_rates(2 * point);
  const Vector3 angular =
      at.to_rate * (-rate.cross(momentum) - moving.tail<3>() - at.coupling * accelerated);
  const Vector3 linear = -rate.cross(drift) - angular.cross(at.center) - moving.head<3>() / mass_ -
                         at.of_center * accelerated;
  Velocity all(6 + accelerated.size());
  all << on_table(linear), angular, accelerated;
  return all;
}

}  // namespace ff

// Motions of a system whose joints go along splines and that nothing pushes, with derivatives by
// the splines' control points. Half steps are the points and the times half-way between them.
#pragma once
#include "base_turn.hpp"
#include "end_conditions.hpp"

namespace ff {

// Where a system begins, and what stays of that.
struct Start {
  Vector3 position;         // of the base
  Matrix3 rotation;         // base to inertial axes
  Vector3 center;           // of mass
  Vector3 linear, angular;  // momentum, the latter about the centre of mass
  bool planar;              // the base moves in the plane of x and y and turns about z
};

class SplineMotion {
 public:
  RowMajor q, v, q_half_way;  // a row a point; half-way between two

  // angles, rates, accelerations: of the joints, a row a half step.
  SplineMotion(const Chain& chain, const Start& start, const RowMajor& angles, const RowMajor& rates,
               const RowMajor& accelerations, double duration)
      : start_(start),
        rates_(rates),
        accelerations_(accelerations),
        duration_(duration),
        step_(2 * duration / static_cast<double>(angles.rows() - 1)),
        momenta_(momenta(chain, angles, start.planar)),
        turn_(momenta_, rates, start.rotation, start.angular, step_),
        end_(chain, angles.row(angles.rows() - 1)),
        drift_(start.linear / end_.composite[0].mass) {
    const int n = chain.joints(), points = static_cast<int>(turn_.steps.size()) + 1;
    q.resize(points, 7 + n), v.resize(points, 6 + n), q_half_way.resize(points - 1, 7 + n);
    for (int i = 0; i < points; ++i) {
      const SystemMomentum& at = momenta_[2 * i];
      const Vector3 rate = rate_at(i), drift = rotation_at(i).transpose() * drift_;
      q.row(i) << place(2 * i, rotation_at(i)), angles.row(2 * i);
      // The centre of mass drifts:  v = R^T P / m - omega x c - dc/dtheta theta'
      const Vector3 linear = drift - rate.cross(at.center) - at.of_center * joint_rates(2 * i);
      v.row(i) << on_table(linear).transpose(), rate.transpose(), rates.row(2 * i);
      if (i + 1 < points)
        q_half_way.row(i) << place(2 * i + 1, turn_.steps[i].half_way), angles.row(2 * i + 1);
    }
  }

  // What the motion misses of a goal.
  Eigen::VectorXd goal_error(const Target& target) const {
    SystemState state = end_state();
    const auto n = rates_.cols();
    state.base_step = state.base_twist_change = Matrix6X(6, 0);
    state.angle_changes = state.rate_changes = state.acceleration_changes = Eigen::MatrixXd(n, 0);
    return conditions(target, state).values;
  }

  // Derivatives by the control points: those of the first joint first. Python's arrays, a block of
  // rows a point, hold those of q, v and q half-way in the tangent space; `acceleration` is dv/dt.
  struct Sensitivity {
    double *q, *v, *q_half_way, *acceleration;
  };

  // rows: angles and rates by the control points of one joint; acceleration_row: accelerations at
  // the end. Returns the derivatives of `goal_error`.
  Eigen::MatrixXd sensitivity(const JointRows& rows, const Eigen::RowVectorXd& acceleration_row,
                              const Target& target, const Sensitivity& to) const {
    const int n = static_cast<int>(rates_.cols()), variables = rows.variables(), size = 6 + n;
    const int points = static_cast<int>(turn_.steps.size()) + 1;
    const TurnDerivatives of(turn_, momenta_, rates_, rows, step_);
    const double mass = end_.composite[0].mass;
    const auto block = [&](double* of_all, int i) {
      return Eigen::Map<RowMajor>(of_all + i * size * variables, size, variables);
    };
    for (int i = 0; i < points; ++i) {
      const SystemMomentum& at = momenta_[2 * i];
      write_step(rows, 2 * i, of.turns[i], block(to.q, i));
      if (i + 1 < points) write_step(rows, 2 * i + 1, of.half_way[i], block(to.q_half_way, i));
      const Vector3 drift = rotation_at(i).transpose() * drift_;
      const Matrix3X of_linear = of.by_joints[i].topRows<3>();
      Matrix3X fall = Matrix3X::Zero(3, variables);
      rows.add(2 * i, of_linear / mass, at.of_center, fall);
      auto dv = block(to.v, i);
      dv.topRows<3>() = skew(drift) * of.turns[i] + skew(at.center) * of.rates[i] - fall;
      if (start_.planar) dv.row(2).setZero();
      dv.middleRows<3>(3) = of.rates[i];
      write_joints(rows.rates.row(2 * i), dv);
      // d/dt (I omega + A theta') = -omega x R^T L, and likewise for P
      const Vector3 rate = rate_at(i), momentum = rotation_at(i).transpose() * start_.angular;
      const Joints joints = joint_rates(2 * i), accelerated = accelerations_.row(2 * i);
      const Vector3 angular =
          at.to_rate * (-rate.cross(momentum) - of.by_joints[i].bottomRows<3>() * joints -
                        at.coupling * accelerated);
      const Vector3 linear = -rate.cross(drift) - angular.cross(at.center) -
                             of_linear * joints / mass - at.of_center * accelerated;
      Eigen::Map<Velocity>(to.acceleration + i * size, size)
          << on_table(linear), angular, accelerated;
    }
    SystemState state = end_state();
    state.base_step = block(to.q, points - 1).topRows<6>();
    state.base_twist_change = block(to.v, points - 1).topRows<6>();
    state.angle_changes = block(to.q, points - 1).bottomRows(n);
    state.rate_changes = block(to.v, points - 1).bottomRows(n);
    state.acceleration_changes = Eigen::MatrixXd::Zero(n, variables);
    for (int j = 0; j < n; ++j)
      state.acceleration_changes.row(j).segment(j * acceleration_row.size(),
                                                acceleration_row.size()) = acceleration_row;
    return conditions(target, state).by;
  }

 private:
  static std::vector<SystemMomentum> momenta(const Chain& chain, const RowMajor& angles, bool planar) {
    std::vector<SystemMomentum> found;
    found.reserve(angles.rows());
    for (int i = 0; i < angles.rows(); ++i)
      found.emplace_back(Posture(chain, angles.row(i)), planar);
    return found;
  }

  Conditions conditions(const Target& target, const SystemState& state) const {
    const EndEffectorMotion tip(end_, state, start_.planar);
    return end_conditions(target, tip, duration_, start_.planar);
  }

  // The last point, without derivatives.
  SystemState end_state() const {
    SystemState state;
    const auto last = q.rows() - 1;
    state.position = q.row(last).head<3>();
    state.rotation = turn_.rotation;
    state.base_twist = v.row(last).head<6>();
    state.rates = v.row(last).tail(rates_.cols());
    state.accelerations = accelerations_.row(accelerations_.rows() - 1);
    return state;
  }

  const Matrix3& rotation_at(int point) const {
    return point < static_cast<int>(turn_.steps.size()) ? turn_.steps[point].rotation
                                                        : turn_.rotation;
  }
  const Vector3& rate_at(int point) const {
    return point < static_cast<int>(turn_.steps.size()) ? turn_.steps[point].rates[0] : turn_.rate;
  }
  Joints joint_rates(int half_step) const { return rates_.row(half_step); }

  // Of the base: position and quaternion. Its centre of mass moves uniformly, whatever the joints do.
  Eigen::Matrix<double, 1, 7> place(int half_step, const Matrix3& rotation) const {
    Vector3 position = start_.center + half_step * step_ / 2 * drift_;
    position -= rotation * momenta_[half_step].center;
    // The table takes up what an axis is off its normal.
    if (start_.planar) position.z() = start_.position.z();
    Eigen::Matrix<double, 1, 7> row;
    row << position.transpose(), quaternion_xyzw(rotation).transpose();
    return row;
  }
  Vector3 on_table(const Vector3& linear) const {
    return start_.planar ? Vector3(linear.x(), linear.y(), 0) : linear;
  }

  // Derivatives of a configuration: the base's step in its own axes, its turn, and the joints.
  template <typename Block>
  void write_step(const JointRows& rows, int half_step, const Matrix3X& turn, Block&& to) const {
    const SystemMomentum& at = momenta_[half_step];
    Matrix3X moved = Matrix3X::Zero(3, turn.cols());
    rows.add(half_step, at.of_center, Matrix3X::Zero(3, rows.joints), moved);
    to.template topRows<3>() = skew(at.center) * turn - moved;
    if (start_.planar) to.row(2).setZero();
    to.template middleRows<3>(3) = turn;
    write_joints(rows.angles.row(half_step), to);
  }
  template <typename Block>
  void write_joints(const Eigen::RowVectorXd& row, Block&& to) const {
    const auto n = rates_.cols(), each = row.size();
    to.bottomRows(n).setZero();
    for (int j = 0; j < n; ++j) to.row(6 + j).segment(j * each, each) = row;
  }

  Start start_;
  RowMajor rates_, accelerations_;
  double duration_, step_;
  std::vector<SystemMomentum> momenta_;  // at the half steps
  BaseTurn turn_;
  Posture end_;
  Vector3 drift_;  // velocity of the centre of mass, inertial axes
};

}  // namespace ff

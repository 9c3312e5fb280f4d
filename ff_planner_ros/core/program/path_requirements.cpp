#include "program/path_requirements.hpp"

namespace ff {

void PositionsWithin::require_fits(const Tree& tree, Eigen::Index) const {
  require(lower.size() == tree.planned && upper.size() == tree.planned,
          "lower and upper are limits of another chain");
}

ConstraintRows PositionsWithin::rows(const LookedAt& at) const {
  const JointsAtPoints joints = at.joints();
  const Eigen::VectorXd start = joints.positions.row(0), all = Eigen::VectorXd::Ones(start.size());
  const Eigen::VectorXd least = -kept(eased(-lower, -start, excess * all), -start, margin * all);
  const Eigen::VectorXd most = kept(eased(upper, start, excess * all), start, margin * all);
  const Eigen::VectorXd near = interest * all, near_stop = stop_interest * all;
  LimitRows found(view(least), view(most), view(near));
  const JointHull& hull = at.motion.positions;
  if (hull.points.size() > 0) {
    found.add_points(hull.points, *hull.by_x);
  } else {
    const Eigen::Index later = joints.points() - 1;
    found.add_points(joints.positions.bottomRows(later), joints.positions_by_x.bottomRows(later));
    found.add_extremes(turns(joints, at.step), joints, at.motion.has_duration());
  }
  LimitRows stops(view(least), view(most), view(near_stop));
  stops.add_stops(at.joints_at_end(), jerk);
  // Below the names of the turns.
  const long long below = -2 - 4 * static_cast<long long>(joints.points() * joints.joints());
  for (const long long name : stops.names) found.names.push_back(below - name);
  found.values.insert(found.values.end(), stops.values.begin(), stops.values.end());
  found.jacobian.insert(found.jacobian.end(), stops.jacobian.begin(), stops.jacobian.end());
  return taken(found);
}

void RatesWithin::require_fits(const Tree& tree, Eigen::Index) const {
  require(limits.size() == tree.planned, "limits are those of another chain");
}

ConstraintRows RatesWithin::rows(const LookedAt& at) const {
  const JointsAtPoints joints = at.joints();
  const Eigen::VectorXd start = joints.rates.row(0).cwiseAbs();
  const Eigen::VectorXd raised = eased(limits, start, excess * limits);
  const Eigen::VectorXd most = kept(raised, start, margin * raised), least = -most;
  const Eigen::VectorXd near = interest * limits;
  LimitRows found(view(least), view(most), view(near));
  const JointHull& hull = at.motion.rates;
  if (hull.points.size() > 0) {
    found.add_points(hull.points, *hull.by_x);
  } else {
    const Eigen::Index later = joints.points() - 1;
    found.add_points(joints.rates.bottomRows(later), joints.rates_by_x.bottomRows(later));
    found.add_extremes(peak_rates(joints, at.step), joints, at.motion.has_duration());
  }
  return taken(found);
}

ConstraintRows AttitudeWithin::rows(const LookedAt& at) const {
  const Path path = at.path();
  const ChaserEuler euler(path.q, path.dq, chaser_to_base);
  const Eigen::VectorXd most = Eigen::VectorXd::Constant(3, limit), least = -most,
                        near = Eigen::VectorXd::Constant(3, interest);
  LimitRows found(view(least), view(most), view(near));
  found.add_points(euler.angles,
                   Rows(euler.jacobian.data(), euler.angles.rows(), 3 * euler.jacobian.cols()));
  return taken(found);
}

ConstraintRows RotationWithin::rows(const LookedAt& at) const {
  const Path path = at.path();
  const Eigen::Index size = at.motion.v.cols();
  const Eigen::Quaterniond to_start = Configuration::read(at.motion.q.row(0)).attitude.conjugate();
  ConstraintRows found;
  for (Eigen::Index i = 0; i < path.q.rows(); ++i) {
    const Eigen::Quaterniond attitude = Configuration::read(path.q.row(i)).attitude;
    const Vector3 since = turn_of_quaternion((to_start * attitude).normalized().coeffs());
    const double angle = since.norm();
    const double measure = angle < knee ? angle * angle / (2 * knee) + knee / 2 : angle;
    if (limit - measure >= interest) continue;
    const Vector3 by_turn = -since / std::max(angle, knee);
    found.add(limit - measure, i, by_turn.transpose() * path.dq.middleRows(i * size + 3, 3));
  }
  return found;
}

ConstraintRows SingularValueAbove::rows(const LookedAt& at) const {
  const PathMotion& motion = at.motion;
  const Eigen::Index size = motion.v.cols(), joints = size - 6;
  const auto value_at = [&](Eigen::Index i) {
    return smallest_singular_value(at.chain, motion.q.row(i).tail(joints), movable,
                                   interest * margin);
  };
  const double least = std::min(margin, value_at(0).value);
  ConstraintRows found;
  for (Eigen::Index i = 1; i < motion.points(); ++i) {
    const SingularValue value = value_at(i);
    if (!(value.value < interest * least)) continue;
    found.add(value.value - least, i,
              value.by_joints.transpose() * at.by_x.q.middleRows(i * size + 6, joints));
  }
  return found;
}

}  // namespace ff

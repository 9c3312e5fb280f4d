#include "program/load_requirements.hpp"

namespace ff {

Parts::Parts(const RowMajor& loads, const RowMajor& loads_by_x, const Eigen::VectorXd& parts)
    : values(loads * parts.asDiagonal()), by_x(loads_by_x) {
  const Eigen::Index each = by_x.cols() / parts.size();
  for (Eigen::Index j = 0; j < parts.size(); ++j) by_x.middleCols(j * each, each) *= parts[j];
}

void Parts::raise_at_peaks() {
  const RowMajor at = values, by = by_x;
  const Eigen::Index each = by_x.cols() / values.cols();
  for (Eigen::Index i = 1; i + 1 < at.rows(); ++i)
    for (Eigen::Index j = 0; j < at.cols(); ++j) {
      const double rise = -(at(i + 1, j) - 2 * at(i, j) + at(i - 1, j)) / 8;
      if (!(rise * at(i, j) > 0)) continue;
      values(i, j) += rise;
      const auto of = [&](Eigen::Index point) { return by.row(point).segment(j * each, each); };
      by_x.row(i).segment(j * each, each) -= (of(i + 1) - 2 * of(i) + of(i - 1)) / 8;
    }
}

ConstraintRows LoadsWithin::within(const Parts& parts, const Eigen::VectorXd& most) const {
  const Eigen::VectorXd least = -most, near = Eigen::VectorXd::Constant(most.size(), interest);
  LimitRows found(view(least), view(most), view(near));
  const Eigen::Index later = parts.values.rows() - 1;
  found.add_points(parts.values.bottomRows(later), parts.by_x.bottomRows(later));
  return taken(found);
}

void AccelerationsWithin::require_fits(const Tree& tree, Eigen::Index points) const {
  require(parts.size() == tree.planned, "parts are those of another chain");
  require(points >= 3, "accelerations need three points");
}

ConstraintRows AccelerationsWithin::rows(const LookedAt& at) const {
  JointAccelerations moved(at.joints(), at.step);
  moved.differentiate(at.joints(), at.step, at.motion.has_duration());
  Parts loads(moved.values, moved.by_x, parts);
  if (between) loads.raise_at_peaks();
  return within(loads, Eigen::VectorXd::Constant(parts.size(), 1 - margin));
}

RowMajor DynamicLoadsWithin::by_x(const InverseDynamics::Derivatives& by, const LookedAt& at,
                                  const JointAccelerations& moved, Eigen::Index point) {
  const Eigen::Index n = at.chain.joints(), size = 6 + n, x = at.motion.variables();
  const Rows of_accelerations(moved.by_x.row(point).data(), n, x);
  RowMajor found = by.leftCols(n) * at.by_x.q.middleRows(point * size + 6, n);
  found.noalias() += by.middleCols(n, size) * at.by_x.v.middleRows(point * size, size);
  found.noalias() += by.rightCols(n) * of_accelerations;
  return found;
}

void TorquesWithin::require_fits(const Tree& tree, Eigen::Index points) const {
  require(parts.size() == tree.planned, "parts are those of another chain");
  require(points >= 3, "torques need three points");
}

ConstraintRows TorquesWithin::rows(const LookedAt& at) const {
  JointAccelerations moved(at.joints(), at.step);
  const Eigen::Index n = parts.size(), x = at.motion.variables();
  RowMajor torques = RowMajor::Zero(at.motion.points(), n), torques_by_x;
  each_point(at, moved.values, [&](Eigen::Index i, const InverseDynamics& of) {
    torques.row(i) = of.torques;
    if ((of.torques.cwiseProduct(parts).cwiseAbs().array() <= 1 - margin - interest).all()) return;
    if (torques_by_x.size() == 0) {
      moved.differentiate(at.joints(), at.step, at.motion.has_duration());
      torques_by_x.setZero(torques.rows(), n * x);
    }
    RowsToFill(torques_by_x.row(i).data(), n, x) = by_x(of.torques_by(), at, moved, i);
  });
  if (torques_by_x.size() == 0) return {};
  return within(Parts(torques, torques_by_x, parts), Eigen::VectorXd::Constant(n, 1 - margin));
}

void GraspWrenchWithin::require_fits(const Tree& tree, Eigen::Index points) const {
  require(link <= tree.joints(), "the grasp is on a link of another chain");
  require(parts.size() == 2, "parts must be two");
  require(points >= 3, "wrenches need three points");
}

ConstraintRows GraspWrenchWithin::rows(const LookedAt& at) const {
  JointAccelerations moved(at.joints(), at.step);
  ConstraintRows found;
  each_point(at, moved.values, [&](Eigen::Index i, const InverseDynamics& of) {
    const HeldBody body = held(at.chain, at.joints().positions.row(i));
    const Vector6 wrench = of.wrench(body);
    const double norms[] = {wrench.head<3>().norm(), wrench.tail<3>().norm()};
    RowMajor by;
    for (int kind = 0; kind < 2; ++kind) {
      const double part = norms[kind] * parts[kind];
      if (!(1 - margin - part < interest)) continue;
      if (moved.by_x.size() == 0)
        moved.differentiate(at.joints(), at.step, at.motion.has_duration());
      if (by.size() == 0) by = by_x(of.wrench_by(body), at, moved, i);
      const Vector3 way = wrench.segment<3>(3 * kind) / norms[kind];
      found.add(1 - margin - part, 2 * i + kind,
                -way.transpose() * by.middleRows<3>(3 * kind) * parts[kind]);
    }
  });
  return found;
}

HeldBody GraspWrenchWithin::held(const Chain& chain, const Joints& positions) const {
  const Pose at = chain.body({Vector3::Zero(), Matrix3::Identity()}, link, positions) *
                  Pose{position, rotation};
  return {link,
          Inertia::of_body(mass, at * center, at.rotation * inertia * at.rotation.transpose()),
          at.inverse().motion_to_inner()};
}

void WheelsWithin::require_fits(const Tree&, Eigen::Index points) const {
  require(momenta.size() == wheels.count() && torques.size() == wheels.count(),
          "momenta and torques are those of other wheels");
  require(points >= 3, "wheels need three points");
}

ConstraintRows WheelsWithin::rows(const LookedAt& at) const {
  const WheelLoads loads(at.chain, wheels, at.motion, at.by_x, at.step);
  Parts of_momenta(loads.momenta, loads.momenta_by_x, momenta);
  const Eigen::VectorXd all = Eigen::VectorXd::Ones(momenta.size()),
                        start = of_momenta.values.row(0).cwiseAbs();
  const Eigen::VectorXd most = kept(eased(all, start, excess * all), start, margin * all);
  if (between) of_momenta.raise_at_peaks();
  ConstraintRows found = within(of_momenta, most);
  Parts of_torques(loads.torques, loads.torques_by_x, torques);
  if (between) of_torques.raise_at_peaks();
  const ConstraintRows more = within(of_torques, (1 - margin) * all);
  found.values.insert(found.values.end(), more.values.begin(), more.values.end());
  found.jacobian.insert(found.jacobian.end(), more.jacobian.begin(), more.jacobian.end());
  for (const long long name : more.names) found.names.push_back(kTorques + name);
  return found;
}

}  // namespace ff

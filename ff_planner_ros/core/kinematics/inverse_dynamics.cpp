#include "kinematics/inverse_dynamics.hpp"

#include "kinematics/cholesky.hpp"

namespace ff {

InverseDynamics::InverseDynamics(const Posture& posture, Base base, const Vector6& base_twist,
                                 const Joints& rates, const Joints& accelerations)
    : torques(rates.size()), posture_(posture), free_(free_rows(base)) {
  const Tree& tree = *posture_.tree;
  const int n = joints();
  const Joints each_rate = tree.rates(rates), each_acceleration = tree.rates(accelerations);
  twists_[0] = base_twist;
  accelerations_[0].setZero();
  for (int k = 0; k < n; ++k) {
    const int before = tree.before[k];
    const Vector6 S = posture_.screws.col(k), moved = S * each_rate[k];
    twists_[k + 1] = twists_[before] + moved;
    accelerations_[k + 1] =
        accelerations_[before] + S * each_acceleration[k] + cross_motion(twists_[before], moved);
  }
  for (int k = 0; k <= n; ++k) {
    momenta_[k] = posture_.body[k] * twists_[k];
    forces_[k] = posture_.body[k] * accelerations_[k] + cross_force(twists_[k], momenta_[k]);
  }
  add_beyond(tree, momenta_);
  add_beyond(tree, forces_);
  // The base accelerates as it must for no force on it.
  const Vector6 of_base = base_acceleration(forces_[0]);
  for (int k = 0; k <= n; ++k) {
    accelerations_[k] += of_base;
    forces_[k] += posture_.composite[k] * of_base;
  }
  JointRow each(n);
  for (int k = 0; k < n; ++k) each[k] = posture_.screws.col(k).dot(forces_[k + 1]);
  torques = tree.by_planned(each).transpose();
}

InverseDynamics::Derivatives InverseDynamics::torques_by() const {
  const int n = joints();
  Forces found(n, columns());
  const Beyond beyond(*this);
  for (int k = 0; k < n; ++k) {
    write(found, k, posture_.screws.col(k), posture_.composite[k + 1], momenta_[k + 1],
          beyond.rates[k + 1], k + 1);
    beyond.write(found.by.row(k), posture_.screws.col(k), k + 1, posture_.tree->beyond(k + 1));
  }
  const Derivatives of_each = with_free_base(found, beyond);
  if (posture_.tree->is_chain()) return of_each;
  return posture_.tree->by_planned(Derivatives(of_each.transpose())).transpose();
}

Vector6 InverseDynamics::wrench(const HeldBody& body) const {
  const Vector6 &V = twists_[body.number], &A = accelerations_[body.number];
  return body.frame.transpose() * (body.inertia * A + cross_force(V, body.inertia * V));
}

InverseDynamics::Derivatives InverseDynamics::wrench_by(const HeldBody& body) const {
  Forces found(6, columns());
  const Vector6& V = twists_[body.number];
  const Vector6 momentum = body.inertia * V;
  for (int i = 0; i < 6; ++i)
    write(found, i, body.frame.col(i), body.inertia, momentum, turning(body.inertia, V),
          body.number);
  return with_free_base(found, Beyond(*this));
}

InverseDynamics::Beyond::Beyond(const InverseDynamics& of)
    : by_joints(6, of.joints()), by_rates(6, of.joints()), by_accelerations(6, of.joints()) {
  const int n = of.joints();
  for (int k = 0; k <= n; ++k) rates[k] = turning(of.posture_.body[k], of.twists_[k]);
  add_beyond(*of.posture_.tree, rates);
  for (int k = 0; k < n; ++k) {
    const Vector6 S = of.posture_.screws.col(k), u = of.carried(k);
    const Inertia& all = of.posture_.composite[k + 1];
    const Vector6 &H = of.momenta_[k + 1], &F = of.forces_[k + 1];
    by_joints.col(k) =
        cross_force(S, F) + all * of.not_turned(k) - cross_force(u, H) - rates[k + 1] * u;
    by_rates.col(k) = rates[k + 1] * S + cross_force(S, H) - 2 * (all * u);
    by_accelerations.col(k) = all * S;
  }
}

void InverseDynamics::Beyond::write(Eigen::Ref<Eigen::RowVectorXd> to, const Vector6& direction,
                                    int first, int count) const {
  const auto n = by_joints.cols();
  to.segment(first, count) = direction.transpose() * by_joints.middleCols(first, count);
  to.segment(n + 6 + first, count) = direction.transpose() * by_rates.middleCols(first, count);
  to.segment(2 * n + 6 + first, count) =
      direction.transpose() * by_accelerations.middleCols(first, count);
}

std::vector<int> InverseDynamics::free_rows(Base base) {
  if (base == Base::kPlanar) return {0, 1, 5};
  if (base == Base::kHeld) return {0, 1, 2};
  return {0, 1, 2, 3, 4, 5};
}

Matrix6 InverseDynamics::turning(const Inertia& inertia, const Vector6& twist) {
  const Matrix6 turned = inertia.matrix() * cross_motion_matrix(twist);
  return -turned - turned.transpose();
}

Vector6 InverseDynamics::carried(int joint) const {
  return cross_motion(posture_.screws.col(joint), twists_[joint + 1]);
}

Vector6 InverseDynamics::not_turned(int joint) const {
  return cross_motion(carried(joint), twists_[joint + 1]) -
         cross_motion(posture_.screws.col(joint), accelerations_[joint + 1]);
}

void InverseDynamics::write(Forces& to, int row, const Vector6& direction, const Inertia& inertia,
                            const Vector6& momentum, const Matrix6& rate, int body) const {
  const int n = joints();
  const Vector6 g = inertia * direction, w = rate * direction - cross_force(direction, momentum);
  for (const int j : posture_.tree->moving(body)) {
    const Vector6 S = posture_.screws.col(j), u = carried(j);
    to.by(row, j) = g.dot(not_turned(j)) - w.dot(u);
    to.by(row, n + 6 + j) = w.dot(S) - 2 * g.dot(u);
    to.by(row, 2 * n + 6 + j) = g.dot(S);
  }
  to.by.row(row).segment<6>(n) = w - cross_force(twists_[0], g);
  to.by_base.row(row) = g;
}

InverseDynamics::Derivatives InverseDynamics::with_free_base(const Forces& forces,
                                                             const Beyond& beyond) const {
  Forces of_base(6, columns());
  for (int i = 0; i < 6; ++i) {
    const Vector6 direction = Vector6::Unit(i);
    write(of_base, i, direction, posture_.composite[0], momenta_[0], beyond.rates[0], 0);
    beyond.write(of_base.by.row(i), direction, 0, joints());
  }
  const Tree& tree = *posture_.tree;
  const Derivatives by = forces.by + forces.by_base * base_accelerations(of_base.by);
  if (tree.is_chain()) return by;
  Derivatives found(by.rows(), 3 * tree.planned + 6);
  found << tree.by_planned(Derivatives(by.leftCols(joints()))), by.middleCols(joints(), 6),
      tree.by_planned(Derivatives(by.middleCols(joints() + 6, joints()))),
      tree.by_planned(Derivatives(by.rightCols(joints())));
  return found;
}

Vector6 InverseDynamics::base_acceleration(const Vector6& force) const {
  const Eigen::MatrixXd inertia = posture_.composite[0].matrix()(free_, free_);
  Vector6 found = Vector6::Zero();
  found(free_) = -solved(cholesky(inertia), Eigen::VectorXd(force(free_)));
  return found;
}

RowMajor InverseDynamics::base_accelerations(const RowMajor& forces) const {
  const Eigen::MatrixXd inertia = posture_.composite[0].matrix()(free_, free_);
  RowMajor found = RowMajor::Zero(6, forces.cols());
  found(free_, Eigen::all) = -solved(cholesky(inertia), RowMajor(forces(free_, Eigen::all)));
  return found;
}

}  // namespace ff

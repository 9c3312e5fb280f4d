#include "kinematics/chain.hpp"

namespace ff {

Tree::Tree(std::vector<int> before, std::vector<Drive> drives, int planned, int tip)
    : before(std::move(before)),
      drives(std::move(drives)),
      planned(planned),
      tip(tip),
      moving_(joints() + 1),
      is_chain_(planned == joints() && tip == joints()) {
  for (int body = 0; body <= joints(); ++body) last_.push_back(body);
  for (int k = 0; k < joints(); ++k) {
    const Drive& drive = this->drives[k];
    is_chain_ &= this->before[k] == k && drive.planned == k;
    moving_[k + 1] = moving_[this->before[k]];
    moving_[k + 1].push_back(k);
    for (const int one : moving_[k + 1]) last_[one + 1] = k + 1;
    last_[0] = k + 1;
  }
}

Joints Tree::positions(const Joints& planned_ones) const {
  if (is_chain_) return planned_ones;
  Joints all = rates(planned_ones);
  for (int k = 0; k < joints(); ++k) all[k] += drives[k].offset;
  return all;
}

Joints Tree::rates(const Joints& planned_ones) const {
  if (is_chain_) return planned_ones;
  Joints all(joints());
  for (int k = 0; k < joints(); ++k)
    all[k] = drives[k].multiplier * planned_ones[drives[k].planned];
  return all;
}

bool are_finite(const Values& numbers) { return (numbers - numbers).sum() == 0; }

Pose Chain::moved(const Pose& at, int joint, double by) const {
  return {at.position + at.rotation * (slides[joint] * by),
          at.rotation * rotation_about(axes[joint], by)};
}

Pose Chain::body(Pose base, int number, const Joints& positions) const {
  const Joints all = tree->positions(positions);
  for (const int k : tree->moving(number)) base = moved(base * placements[k], k, all[k]);
  return base;
}

Configuration Configuration::read(const Eigen::Ref<const Eigen::RowVectorXd>& q) {
  return {q.head<3>(), Eigen::Quaterniond(q[6], q[3], q[4], q[5]), q.tail(q.size() - 7)};
}

void Configuration::write(Eigen::Ref<Eigen::RowVectorXd> q) const {
  q << position.transpose(), attitude.coeffs().transpose(), joints.transpose();
}

Configuration Configuration::step(const Velocity& by) const {
  const Vector6 of_base = by.head<6>();
  return {position + attitude * exponential(of_base).position,
          (attitude * turn(of_base)).normalized(), joints + by.tail(joints.size())};
}

Posture::Posture(const Chain& chain, const Joints& joints)
    : tree(chain.tree), screws(6, tree->joints()) {
  const Joints positions = tree->positions(joints);
  std::array<Pose, kMaxJoints + 1> frames;  // of the bodies
  frames[0] = {Vector3::Zero(), Matrix3::Identity()};
  body[0] = Inertia::of_body(chain.masses[0], chain.centers[0], chain.inertias[0]);
  for (int k = 0; k < tree->joints(); ++k) {
    Pose& at = frames[k + 1] = frames[tree->before[k]] * chain.placements[k];
    const Vector3 axis = at.rotation * chain.axes[k], slide = at.rotation * chain.slides[k];
    screws.col(k) = stack(at.position.cross(axis) + slide, axis);
    at = chain.moved(at, k, positions[k]);
    body[k + 1] =
        Inertia::of_body(chain.masses[k + 1], at.position + at.rotation * chain.centers[k + 1],
                         at.rotation * chain.inertias[k + 1] * at.rotation.transpose());
  }
  tip = frames[tree->tip] * chain.tip;
  for (int k = 0; k <= tree->joints(); ++k) composite[k] = body[k];
  add_beyond(*tree, composite);
}

std::array<Vector6, kMaxJoints + 1> Posture::twists(const Vector6& base,
                                                    const Joints& rates) const {
  const Joints all = tree->rates(rates);
  std::array<Vector6, kMaxJoints + 1> found;
  found[0] = base;
  for (int k = 0; k < tree->joints(); ++k)
    found[k + 1] = found[tree->before[k]] + screws.col(k) * all[k];
  return found;
}

Matrix6J Posture::of_tip(Matrix6J by_each) const {
  if (!tree->is_chain())
    for (int k = 0; k < tree->joints(); ++k)
      if (!tree->moves_tip(k)) by_each.col(k).setZero();
  return by_each;
}

}  // namespace ff

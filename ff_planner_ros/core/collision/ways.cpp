#include "collision/ways.hpp"

namespace ff {
namespace {

// Bounds of the rates in each interval, by the part of it: of the base's place and turn, then of
// the joints. The derivative of a cubic is a quadratic, and is never beyond its Bezier points; that
// of the base's place V(phi) nu is at most |nu'| + |phi'| |nu| / 2.
RowMajor rates_of(const CubicMotion& motion) {
  const Tree& tree = *motion.chain.tree;
  const Eigen::Index intervals = motion.times.size() - 1, joints = tree.planned;
  RowMajor rates(intervals, 2 + joints);
  for (Eigen::Index i = 0; i < intervals; ++i) {
    const auto first = motion.cubics.row(3 * i), second = motion.cubics.row(3 * i + 1),
               third = motion.cubics.row(3 * i + 2);
    RowMajor of_rate(3, 6 + joints), of_way(3, 3);
    of_rate << first, first + second, first + 2 * second + 3 * third;
    of_way << (first / 3).head<3>(), (2 * first + second).head<3>() / 3,
        (first + second + third).head<3>();
    const double moving = of_rate.leftCols<3>().rowwise().norm().maxCoeff();
    const double turning = of_rate.middleCols<3>(3).rowwise().norm().maxCoeff();
    rates.row(i) << moving + turning * of_way.rowwise().norm().maxCoeff() / 2, turning,
        of_rate.rightCols(joints).cwiseAbs().colwise().maxCoeff();
  }
  if (tree.is_chain()) return rates;
  RowMajor of_each(intervals, 2 + tree.joints());
  of_each.leftCols<2>() = rates.leftCols<2>();
  for (int k = 0; k < tree.joints(); ++k)
    of_each.col(2 + k) =
        std::abs(tree.drives[k].multiplier) * rates.col(2 + tree.drives[k].planned);
  return of_each;
}

// The stretched arm, and the spheres around its bodies.
class Levers {
 public:
  Levers(const CubicMotion& motion, const RowMajor& rates)
      : chain_(motion.chain), tree_(*chain_.tree), slid_(Joints::Zero(tree_.joints())) {
    for (int k = 0; k < tree_.joints(); ++k) {
      if (!slides(k)) continue;
      for (const Configuration& q : motion.q)
        slid_[k] = std::max(slid_[k], std::abs(tree_.positions(q.joints)[k]));
      slid_[k] += rates.col(2 + k).maxCoeff();
    }
    reached_.push_back(0);
    for (int k = 0; k < tree_.joints(); ++k)
      reached_.push_back(reached_[tree_.before[k]] + chain_.placements[k].position.norm() +
                         slid_[k]);
  }

  // Of a body's points: from the base, then from each joint that moves the body.
  Joints outwards(const Body& body) const {
    const int last = body.link;
    const double around = body.radius + (body.stretches() ? slid_[tree_.to_tip(last)] : 0);
    Joints levers = Joints::Zero(1 + tree_.joints());
    const auto lever = [&](int k) {
      return reached_[last] - reached_[k] + body.center.norm() + around;
    };
    levers[0] = lever(0);
    for (const int k : tree_.moving(last)) levers[1 + k] = slides(k) ? 1 : lever(1 + k);
    if (last > 0 && !slides(last - 1))
      levers[last] = body.center.cross(chain_.axes[last - 1]).norm() + around;
    if (body.stretches()) levers[1 + tree_.to_tip(last)] = 1;
    return levers;
  }

  // From joint k to a body's points, where the joint is beyond the body.
  double back(const Body& body, int k) const {
    if (slides(k)) return 1;
    const int next = tree_.moving(k + 1)[tree_.moving(body.link).size()];
    const Pose& joint = chain_.placements[next];
    const Vector3 center = joint.inverse() * body.center;
    if (k == next) return center.cross(chain_.axes[k]).norm() + body.radius;
    return center.norm() + body.radius + slid_[next] + reached_[k + 1] - reached_[next + 1];
  }

 private:
  bool slides(int k) const { return !chain_.slides[k].isZero(0); }

  const Chain& chain_;
  const Tree& tree_;
  Joints slid_;                  // how far each joint slides from zero at most
  std::vector<double> reached_;  // how far each joint's frame, after the base's, is from the base
};

}  // namespace

Ways::Ways(const RowMajor& in_intervals)
    : sums_(RowMajor::Zero(in_intervals.rows() + 1, in_intervals.cols())) {
  for (Eigen::Index i = 0; i < in_intervals.rows(); ++i)
    sums_.row(i + 1) = sums_.row(i) + in_intervals.row(i);
  if (!sums_.allFinite()) throw std::invalid_argument("a motion is too far to be followed");
}

double Ways::until(double step, int column) const {
  const int point = std::min(static_cast<int>(step), static_cast<int>(sums_.rows()) - 2);
  return sums_(point, column) + (step - point) * (sums_(point + 1, column) - sums_(point, column));
}

Ways ways_of_bodies(const CubicMotion& motion, const Bodies& of) {
  const RowMajor rates = rates_of(motion);
  const Levers levers(motion, rates);
  RowMajor ways(rates.rows(), of.bodies.size());
  for (size_t body = 0; body < of.bodies.size(); ++body)
    ways.col(body) =
        rates.col(0) + rates.rightCols(rates.cols() - 1) * levers.outwards(of.bodies[body]);
  return Ways(ways);
}

Ways ways_of_pairs(const CubicMotion& motion, const Bodies& of) {
  const RowMajor rates = rates_of(motion);
  const Levers levers(motion, rates);
  const Tree& tree = *motion.chain.tree;
  RowMajor ways = RowMajor::Zero(rates.rows(), of.pairs.size());
  for (size_t pair = 0; pair < of.pairs.size(); ++pair) {
    const auto [a, b] = of.pairs[pair];
    const auto add = [&](const Body& moved, const Body& other) {
      const Joints outwards = levers.outwards(moved);
      const std::vector<int>&of_moved = tree.moving(moved.link),
            &of_other = tree.moving(other.link);
      // A joint between both changes their distance equally by whichever it is said to move.
      const bool is_between = of_other.empty() || tree.moves(of_other.back(), moved.link);
      for (const int k : of_moved) {
        if (tree.moves(k, other.link)) continue;
        const double lever = outwards[1 + k];
        ways.col(pair) +=
            (is_between ? std::min(lever, levers.back(other, k)) : lever) * rates.col(2 + k);
      }
    };
    add(of.bodies[b], of.bodies[a]);
    add(of.bodies[a], of.bodies[b]);
  }
  return Ways(ways);
}

double highest_speed(const Obstacle& obstacle, double fastest_turn) {
  // Of a sphere only the centre: its surface is as far away however it turns.
  const double radius = obstacle.solid.is_sphere() ? 0 : obstacle.radius;
  if (!obstacle.body)
    return obstacle.velocity.norm() + obstacle.rate.norm() * (obstacle.center.norm() + radius);
  const double lever = (obstacle.begin * obstacle.center).norm() + radius;
  return obstacle.body->velocity.norm() + fastest_turn * lever;
}

}  // namespace ff

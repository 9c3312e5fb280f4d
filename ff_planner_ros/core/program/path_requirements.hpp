// What the core knows to require of a path on a time grid, as rows g(x) >= 0 of a program.
#pragma once
#include <any>

#include "collision/obstacles.hpp"
#include "kinematics/chaser_euler.hpp"
#include "kinematics/singular_values.hpp"
#include "optimisation/limit_rows.hpp"
#include "program/evaluated_path.hpp"

namespace ff {

// A path at which rows are asked for, and what several requirements share there.
class LookedAt {
 public:
  const Chain& chain;
  const PathMotion& motion;
  const PathDerivatives& by_x;
  mutable std::any elsewhere;  // the same path as those see it that the core does not know

  LookedAt(const Chain& chain, const PathMotion& motion, const PathDerivatives& by_x)
      : chain(chain), motion(motion), by_x(by_x) {}

  // The configurations of all points but the first, then those half-way.
  Path path() const { return from(1, motion.q.rows() - 1); }

  // Where the bodies of the robot are there, and at quarters of the intervals if they are asked
  // for.
  const BodiesAlong& bodies(const Bodies& of, bool quarter_way) const {
    if (!bodies_) {
      const Eigen::Index gaps = motion.points() - 1;
      bodies_.emplace(chain, of,
                      DensePath(from(1, gaps), from(motion.points(), gaps), quarter_way));
    }
    return *bodies_;
  }

  JointsAtPoints joints() const { return joints_at(0); }
  JointsAtPoints joints_at_end() const { return joints_at(motion.points() - 1); }

 private:
  Path from(Eigen::Index first, Eigen::Index count) const {
    const Eigen::Index size = motion.v.cols();
    return {{motion.q.data() + first * motion.q.cols(), count, motion.q.cols()},
            {by_x.q.data() + first * size * motion.variables(), count * size, motion.variables()}};
  }

  // From a point on; of derivatives, a row a point.
  JointsAtPoints joints_at(Eigen::Index first) const {
    const Eigen::Index size = motion.v.cols(), joints = size - 6, count = motion.points() - first;
    const Eigen::Index each = size * motion.variables();
    const Rows by_q(by_x.q.data() + first * each, count, each);
    const Rows by_v(by_x.v.data() + first * each, count, each);
    const Eigen::Index of_joints = joints * motion.variables();
    return {motion.q.middleRows(first, count).rightCols(joints),
            motion.v.bottomRows(count).rightCols(joints), by_q.rightCols(of_joints),
            by_v.rightCols(of_joints)};
  }

  mutable std::optional<BodiesAlong> bodies_;
};

class PathRequirement {
 public:
  virtual ~PathRequirement() = default;
  virtual ConstraintRows rows(const LookedAt& at) const = 0;
  // Throws where it is of other joints, or of another number of points.
  virtual void require_fits(Eigen::Index /*joints*/, Eigen::Index /*points*/) const {}

 protected:
  static void require(bool fits, const char* message) {
    if (!fits) throw std::invalid_argument(message);
  }
};

// Limits, raised to the start's values where those exceed them by little.
inline Eigen::VectorXd eased(const Eigen::VectorXd& limits, const Eigen::VectorXd& at_start,
                             const Eigen::VectorXd& excess) {
  return (at_start.array() <= (limits + excess).array()).select(limits.cwiseMax(at_start), limits);
}

// What is kept of a limit: less by a margin, but not less than what the start needs.
inline Eigen::VectorXd kept(const Eigen::VectorXd& limits, const Eigen::VectorXd& at_start,
                            const Eigen::VectorXd& margin) {
  return limits - (limits - at_start).cwiseMax(0).cwiseMin(margin);
}

inline ConstraintRows taken(LimitRows& rows) {
  return {std::move(rows.values), std::move(rows.jacobian), std::move(rows.names)};
}

// Joint positions at points and where joints turn round, and where joints come to rest that stop
// after the last point.
struct PositionsWithin : PathRequirement {
  Eigen::VectorXd lower, upper;
  double excess, margin, interest;  // [rad, m]
  double stop_interest, jerk;
  double step;  // time between two points [s]

  void require_fits(Eigen::Index joints, Eigen::Index) const override {
    require(lower.size() == joints, "lower and upper are limits of another chain");
  }
  ConstraintRows rows(const LookedAt& at) const override {
    const JointsAtPoints joints = at.joints();
    const Eigen::VectorXd start = joints.positions.row(0),
                          all = Eigen::VectorXd::Ones(start.size());
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
      found.add_extremes(turns(joints, step), joints, false);
    }
    LimitRows stops(view(least), view(most), view(near_stop));
    stops.add_stops(at.joints_at_end(), jerk);
    // Below the names of the turns.
    const long long below = -2 - 2 * static_cast<long long>(joints.points() * joints.joints());
    for (const long long name : stops.names) found.names.push_back(below - name);
    found.values.insert(found.values.end(), stops.values.begin(), stops.values.end());
    found.jacobian.insert(found.jacobian.end(), stops.jacobian.begin(), stops.jacobian.end());
    return taken(found);
  }
};

// Joint rates at points and where they peak.
struct RatesWithin : PathRequirement {
  Eigen::VectorXd limits;           // [rad/s, m/s]
  double excess, margin, interest;  // fractions of the limits; the last: of what is far from them
  double step;                      // time between two points [s]

  void require_fits(Eigen::Index joints, Eigen::Index) const override {
    require(limits.size() == joints, "limits are those of another chain");
  }
  ConstraintRows rows(const LookedAt& at) const override {
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
      found.add_extremes(peak_rates(joints, step), joints, false);
    }
    return taken(found);
  }
};

// The chaser's Euler angles at points and half-way.
struct AttitudeWithin : PathRequirement {
  Matrix3 chaser_to_base;
  double limit, interest;  // [rad]

  ConstraintRows rows(const LookedAt& at) const override {
    const Path path = at.path();
    const ChaserEuler euler(path.q, path.dq, chaser_to_base);
    const Eigen::VectorXd most = Eigen::VectorXd::Constant(3, limit), least = -most,
                          near = Eigen::VectorXd::Constant(3, interest);
    LimitRows found(view(least), view(most), view(near));
    found.add_points(euler.angles,
                     Rows(euler.jacobian.data(), euler.angles.rows(), 3 * euler.jacobian.cols()));
    return taken(found);
  }
};

// The smallest singular value of the generalised Jacobian at all points but the first.
struct SingularValueAbove : PathRequirement {
  Vector6 movable;          // rows of the base that give way: one, the others: zero
  double margin, interest;  // the latter a multiple of the margin

  ConstraintRows rows(const LookedAt& at) const override {
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
      found.values.push_back(value.value - least);
      found.names.push_back(i);
      const Eigen::RowVectorXd by_x =
          value.by_joints.transpose() * at.by_x.q.middleRows(i * size + 6, joints);
      found.jacobian.insert(found.jacobian.end(), by_x.data(), by_x.data() + by_x.size());
    }
    return found;
  }
};

// The margins that distances must keep: no more than the room at the start. A much smaller room
// grows to the margin as the cube of the time.
struct Margins {
  double margin;         // the largest [m]
  Eigen::VectorXd room;  // of each pair, by its number [m]
  double little;         // a room below this fraction of the margin grows,
  double gained;         // and has grown in this fraction of the duration

  // names: configuration times the number of pairs, plus pair; times: of the configurations.
  void subtract_from(std::vector<double>& distances, const std::vector<long long>& names,
                     const Eigen::VectorXd& times) const {
    const long long pairs = room.size();
    const double until = gained * times.maxCoeff();
    for (size_t row = 0; row < distances.size(); ++row) {
      double least = room[names[row] % pairs];
      if (least < little * margin) {
        const long long at = names[row] / pairs;
        if (at >= times.size()) throw std::domain_error("there are more pairs than at the start");
        const double part = std::min(times[at] / until, 1.0);
        least += margin * (part * part * part);
      }
      distances[row] -= std::min(margin, least);
    }
  }
};

inline ConstraintRows taken(ClearanceRows& rows) {
  return {std::move(rows.distances), std::move(rows.jacobian), std::move(rows.names)};
}

// Distances from obstacles that a requirement asks for.
struct DistancesKept : PathRequirement {
  Margins margins;
  Eigen::VectorXd times;  // of the configurations at which they are measured [s]
  double interest;        // [m]
  bool quarter_way;       // whether those include quarters of the intervals

  void require_fits(Eigen::Index, Eigen::Index points) const override {
    const Eigen::Index gaps = points - 1, quarters = quarter_way ? 2 * (gaps - 1) : 0;
    require(times.size() == 2 * gaps + quarters, "times are those of another number of points");
  }
  Times at_times() const { return {view(times), Values(nullptr, 0)}; }
  ConstraintRows kept(ClearanceRows found) const {
    margins.subtract_from(found.distances, found.names, times);
    return taken(found);
  }
};

// Of the arm's centre lines from spheres.
struct LinesClearOfSpheres : DistancesKept {
  std::shared_ptr<const std::vector<Sphere>> spheres;

  ConstraintRows rows(const LookedAt& at) const override {
    ArmMotion arm(at.chain, at.path());
    if (quarter_way) arm.add_quarter_way();
    return kept(clearance_rows(arm, at_times(), *spheres, interest));
  }
};

// Of the robot's bodies from spheres, from other obstacles, and from each other.
struct BodiesClearOfSpheres : DistancesKept {
  std::shared_ptr<const Bodies> bodies;
  std::shared_ptr<const std::vector<Sphere>> spheres;

  ConstraintRows rows(const LookedAt& at) const override {
    return kept(sphere_rows(at.bodies(*bodies, quarter_way), at_times(), *spheres, interest));
  }
};

struct BodiesClearOfObstacles : DistancesKept {
  std::shared_ptr<const Bodies> bodies;
  std::shared_ptr<const std::vector<Obstacle>> obstacles;

  ConstraintRows rows(const LookedAt& at) const override {
    return kept(obstacle_rows(at.bodies(*bodies, quarter_way), at_times(), *obstacles, interest));
  }
};

struct PairsApart : PathRequirement {
  std::shared_ptr<const Bodies> bodies;
  Eigen::VectorXd margins;  // of each pair [m]
  double interest;          // [m]
  bool quarter_way;

  ConstraintRows rows(const LookedAt& at) const override {
    ClearanceRows found = pair_rows(at.bodies(*bodies, quarter_way), interest);
    const long long pairs = margins.size();
    for (size_t row = 0; row < found.distances.size(); ++row)
      found.distances[row] -= margins[found.names[row] % pairs];
    return taken(found);
  }
};

}  // namespace ff

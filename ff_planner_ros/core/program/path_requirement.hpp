// A requirement of a path on a time grid, as rows g(x) >= 0 of a program, and what several share.
#pragma once
#include <any>
#include <map>
#include <utility>

#include "collision/bodies.hpp"
#include "program/evaluated_path.hpp"

namespace ff {

// A path at which rows are asked for, and what several requirements share there.
class LookedAt {
 public:
  const Chain& chain;
  const PathMotion& motion;
  const PathDerivatives& by_x;
  const double step;           // time between two points [s]
  mutable std::any elsewhere;  // the same path as those see it that the core does not know

  LookedAt(const Chain& chain, const PathMotion& motion, const PathDerivatives& by_x, double step)
      : chain(chain), motion(motion), by_x(by_x), step(step) {}

  // The configurations of all points but the first, then those half-way.
  Path path() const { return from(1, motion.q.rows() - 1); }

  // Where the bodies of the robot are there, and at quarters of the intervals if they are asked
  // for.
  const BodiesAlong& bodies(const Bodies& of, bool quarter_way) const;

  JointsAtPoints joints() const { return joints_of(motion, by_x); }
  JointsAtPoints joints_at_end() const { return joints_of(motion, by_x, motion.points() - 1); }

 private:
  Path from(Eigen::Index first, Eigen::Index count) const;

  // Of each robot's bodies, without and with the quarters.
  mutable std::map<std::pair<const Bodies*, bool>, BodiesAlong> bodies_;
};

class PathRequirement {
 public:
  virtual ~PathRequirement() = default;
  virtual ConstraintRows rows(const LookedAt& at) const = 0;
  // Throws where it is of other joints, or of another number of points.
  virtual void require_fits(const Tree& /*tree*/, Eigen::Index /*points*/) const {}

 protected:
  static void require(bool fits, const char* message);
};

// Limits, raised to the start's values where those exceed them by little.
Eigen::VectorXd eased(const Eigen::VectorXd& limits, const Eigen::VectorXd& at_start,
                      const Eigen::VectorXd& excess);

// What is kept of a limit: less by a margin, but not less than what the start needs.
Eigen::VectorXd kept(const Eigen::VectorXd& limits, const Eigen::VectorXd& at_start,
                     const Eigen::VectorXd& margin);

ConstraintRows taken(LimitRows& rows);

}  // namespace ff

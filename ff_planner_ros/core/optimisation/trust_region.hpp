// A trust-region SQP method: minimise f(x) + max_j p_j(x)  subject to  g(x) >= 0, h(x) = 0.
//
// Each iteration solves a quadratic subproblem with the Gauss-Newton Hessian of f and an SR1
// approximation of the curvature of max terms and constraints. The exact L-infinity merit function
// decides whether its step is taken, by the gain ratio. Where that is small because the equalities
// are curved, a second-order correction is tried. Names are those of Nocedal and Wright, "Numerical
// Optimization", chapters 6, 15 and 18.
#pragma once
#include <functional>
#include <memory>

#include "optimisation/sr1.hpp"
#include "optimisation/subproblem.hpp"

namespace ff {

// The functions at some x; whoever evaluates them may keep more beside them.
using FunctionsAt = std::shared_ptr<const Functions>;
using Linearise = std::function<FunctionsAt(const Eigen::VectorXd&)>;

// When the search ends.
struct Options {
  int iterations;      // at most
  double tolerance;    // first-order optimality
  double progress;     // relative reduction of the objective that a step must predict
  double tolerated;    // violation up to which the objective alone may judge a step
  double feasibility;  // a constraint that is violated by less counts as kept
  double inside;       // how far inside the constraints steps aim [unit of g]
};

enum class Stop { kUndefined, kIterations, kOptimality, kProgress, kCreeping, kStuck, kStalled };

// Where the search begins, is, and ends.
struct Place {
  Eigen::VectorXd x;
  FunctionsAt at_x;
  RowMajor curvature;  // SR1, of max terms and constraints, weighted by their multipliers
  double radius;       // of the trust region, infinity norm, in units of x
};

struct Solution {
  Place end;
  int iterations = 0;
  Stop stop = Stop::kIterations;
  bool converged = false;  // no constraint is violated, and the objective is known to six digits
  // Largest entry of the Lagrangian's gradient, or of a constraint times its multiplier; NaN where
  // no quadratic program was solved at x.
  double optimality = std::numeric_limits<double>::quiet_NaN();
};

class TrustRegionSolver {
 public:
  TrustRegionSolver(Linearise linearise, Place start, const Options& options)
      : linearise_(std::move(linearise)), at_(std::move(start)), options_(options) {}

  Solution minimise();

 private:
  using Vector = Eigen::VectorXd;
  static constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

  struct Trial {
    FunctionsAt at_x;
    Vector dx;
    double gain_ratio;
  };

  const Functions& here() const { return *at_.at_x; }

  Stop descend(Solution& found);

  // With the SR1 curvature, made positive semidefinite.
  RowMajor convex_hessian() const;

  // A step, and the penalty of the merit function that judges it.
  //
  // The penalty is the lowest that leaves hardly more of the linearised violation than the highest;
  // if none is left, it follows the multipliers. Too high a penalty makes the solver refuse good
  // steps along curved constraints.
  Step step_and_penalty(const Functions& model, const std::optional<WorkingSet>& guess);

  Step solve(const Functions& model, double penalty, const std::optional<WorkingSet>& guess,
             bool elastic) const;

  std::optional<Stop> convergence(const Step& step, bool& converged) const;

  // Where a step leads or, where its gain ratio is small, its second-order correction.
  Trial tried(const Step& step) const;

  Trial tried(const Step& step, const Vector& dx) const;

  // Reduction of the merit function.
  double reduction(double objective, double violation) const;
  double reduction(const Functions& after) const;

  // Actual over predicted reduction.
  double gain_ratio(const Functions& at_trial, const Step& step) const;

  double next_radius(const Trial& trial) const;

  bool is_stagnant(const std::vector<double>& violations) const;

  // The end effector path's coefficients are metres and radians: four units are more than any arm's
  // workspace has room for.
  static constexpr double kLargestRadius = 4, kSmallestRadius = 1e-7;
  // A step of this part of the radius is limited by it.
  static constexpr double kAtBound = 0.9;
  // A step is taken if its gain ratio is above the first value; the trust region shrinks below the
  // second, to this part of the step, and grows above the last.
  static constexpr double kAccept = 0.1, kShrink = 0.25, kShrunk = 0.4, kGrow = 0.7;
  // Penalty of the merit function: where it begins, its bounds, its steps.
  static constexpr double kFirstPenalty = 10, kLowestPenalty = 1e-2, kHighestPenalty = 1e5,
                          kPenaltyFactor = 100;
  // The merit function is exact above the multipliers' sum; the markup leaves them room to grow.
  static constexpr double kMarkup = 2, kHardlyMore = 1.1;
  // A violation that does not fall to this part of itself in this many iterations is stagnant; but
  // a small one [unit of g] only waits for the trust region to become as small.
  static constexpr double kStagnant = 0.7, kSmallViolation = 2e-3;
  static constexpr size_t kPatience = 4;
  // A smaller predicted reduction is rounding; no step can be judged by it.
  static constexpr double kLeastReduction = 1e-12;
  // If the mean of so many steps is below what each must predict, the solver creeps along a kink.
  static constexpr size_t kCreep = 8;
  // The objective is known to six digits if no step predicts a tenth of the sixth: all further
  // steps together bring less than ten times as much.
  static constexpr double kSixDigits = 1e-7;

  const Linearise linearise_;
  Place at_;
  const Options options_;
  double penalty_ = kFirstPenalty;
};

}  // namespace ff

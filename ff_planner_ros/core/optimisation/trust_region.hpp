// A trust-region SQP method: minimise f(x) + max_j p_j(x)  subject to  g(x) >= 0, h(x) = 0.
//
// Each iteration solves a quadratic subproblem with the Gauss-Newton Hessian of f and an SR1
// approximation of the curvature of max terms and constraints. The exact L-infinity merit function
// decides whether its step is taken, by the gain ratio. Where that is small because the equalities
// are curved, a second-order correction is tried. Names are those of Nocedal and Wright, "Numerical
// Optimization", chapters 6, 15 and 18.
#pragma once
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <cmath>
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

  Solution minimise() {
    Solution found;
    found.stop = here().is_defined ? descend(found) : Stop::kUndefined;
    found.end = std::move(at_);
    return found;
  }

 private:
  using Vector = Eigen::VectorXd;
  static constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

  struct Trial {
    FunctionsAt at_x;
    Vector dx;
    double gain_ratio;
  };

  const Functions& here() const { return *at_.at_x; }

  Stop descend(Solution& found) {
    std::vector<double> violations = {here().violation()}, objectives(kCreep, kUnknown);
    std::optional<WorkingSet> working_set;
    while (found.iterations < options_.iterations) {
      const double objective = here().objective();
      objectives.push_back(here().violation() <= kSmallViolation ? objective : kUnknown);
      const double brought = objectives[objectives.size() - 1 - kCreep] - objectives.back();
      if (std::abs(brought) <= kCreep * options_.progress * std::abs(objective))
        return Stop::kCreeping;
      ++found.iterations;
      const RowMajor hessian = convex_hessian();
      const Step step = step_and_penalty(here().with_hessian(hessian), working_set);
      found.optimality = step.optimality;
      working_set = step.working_set;
      if (const auto stop = convergence(step, found.converged)) return *stop;
      const Trial trial = tried(step);
      if (trial.at_x->is_defined)
        sr1_update(at_.curvature, here(), *trial.at_x, trial.dx, step.on_max_terms,
                   step.on_constraints);
      const bool is_taken = trial.gain_ratio > kAccept;
      if (is_taken) {
        at_.x += trial.dx;
        at_.at_x = trial.at_x;
        found.optimality = kUnknown;
      }
      at_.radius = next_radius(trial);
      // With equalities the first steps are often too long, and not taken; and as long as the
      // linearised constraints can hold, the violation may still fall.
      if (here().equalities.size() == 0 || (is_taken && step.violation > options_.feasibility))
        violations.push_back(here().violation());
      if (options_.tolerated == 0 && is_stagnant(violations)) return Stop::kStuck;
      if (at_.radius < kSmallestRadius) return Stop::kStalled;
    }
    return Stop::kIterations;
  }

  // With the SR1 curvature, made positive semidefinite.
  RowMajor convex_hessian() const {
    if (here().max_terms.size() == 0) return here().hessian;
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> parts(here().hessian + at_.curvature);
    const auto& vectors = parts.eigenvectors();
    return vectors * parts.eigenvalues().cwiseMax(0).asDiagonal() * vectors.transpose();
  }

  // A step, and the penalty of the merit function that judges it.
  //
  // The penalty is the lowest that leaves hardly more of the linearised violation than the highest;
  // if none is left, it follows the multipliers. Too high a penalty makes the solver refuse good
  // steps along curved constraints.
  Step step_and_penalty(const Functions& model, const std::optional<WorkingSet>& guess) {
    std::vector<double> penalties = {penalty_};
    std::vector<Step> steps = {solve(model, penalty_, guess, false)};
    while (steps.back().violation > options_.feasibility && penalties.back() < kHighestPenalty) {
      penalties.push_back(kPenaltyFactor * penalties.back());
      const Step& last = steps.back();
      steps.push_back(solve(model, penalties.back(), last.working_set, last.is_elastic));
    }
    const double enough = std::max(kHardlyMore * steps.back().violation, options_.feasibility);
    size_t chosen = 0;
    while (steps[chosen].violation > enough) ++chosen;
    const Step& step = steps[chosen];
    penalty_ = penalties[chosen];
    if (step.violation <= options_.feasibility) {
      const double multipliers = step.on_constraints.sum() + step.on_equalities.lpNorm<1>();
      penalty_ = std::max(kMarkup * multipliers, kLowestPenalty);
    }
    return step;
  }

  Step solve(const Functions& model, double penalty, const std::optional<WorkingSet>& guess,
             bool elastic) const {
    return solve_subproblem(model, at_.radius, penalty, options_.inside, guess, elastic);
  }

  std::optional<Stop> convergence(const Step& step, bool& converged) const {
    if (here().violation() > options_.feasibility) return std::nullopt;
    const double objective = std::abs(here().objective());
    const double predicted = reduction(step.objective, step.violation);
    const double length = step.dx.lpNorm<Eigen::Infinity>();
    const bool is_interior = length < kAtBound * at_.radius;
    std::optional<Stop> stop;
    if (step.optimality <= options_.tolerance)
      stop = Stop::kOptimality;
    else if (is_interior && length > 0 && predicted <= options_.progress * objective)
      stop = Stop::kProgress;
    const double known = std::max(kSixDigits * objective, kLeastReduction);
    converged = stop && is_interior && std::abs(predicted) <= known;
    return stop;
  }

  // Where a step leads or, where its gain ratio is small, its second-order correction.
  Trial tried(const Step& step) const {
    const Trial trial = tried(step, step.dx);
    if (trial.gain_ratio >= kShrink || !trial.at_x->is_defined || here().equalities.size() == 0)
      return trial;
    Vector dx;
    if (options_.tolerated > 0) {
      // The shortest step that brings the equalities, as they are at the trial x, back to zero. It
      // looks at neither trust region nor constraints, and takes a tenth of a quadratic
      // subproblem's time. Where violations on the way are tolerated, plans are as good; elsewhere
      // it lost one that is hard to find.
      const Vector correction = Eigen::MatrixXd(here().equalities_jacobian)
                                    .completeOrthogonalDecomposition()
                                    .solve(-trial.at_x->equalities);
      // Of 215 corrections longer than their steps 5 were taken, of 2,866 others 1,484.
      if (correction.lpNorm<Eigen::Infinity>() > step.dx.lpNorm<Eigen::Infinity>()) return trial;
      dx = step.dx + correction;
    } else {
      const Vector curved = trial.at_x->equalities - here().equalities_jacobian * step.dx;
      dx = solve(here().with_equalities(curved), penalty_, step.working_set, false).dx;
    }
    const Trial corrected = tried(step, dx);
    const double least = std::max(reduction(*trial.at_x), 0.0);
    return reduction(*corrected.at_x) > least ? corrected : trial;
  }

  Trial tried(const Step& step, const Vector& dx) const {
    FunctionsAt at_trial = linearise_(at_.x + dx);
    const double ratio = gain_ratio(*at_trial, step);
    return {std::move(at_trial), dx, ratio};
  }

  // Reduction of the merit function.
  double reduction(double objective, double violation) const {
    return (here().objective() - objective) + penalty_ * (here().violation() - violation);
  }
  double reduction(const Functions& after) const {
    return after.is_defined ? reduction(after.objective(), after.violation())
                            : -std::numeric_limits<double>::infinity();
  }

  // Actual over predicted reduction.
  double gain_ratio(const Functions& at_trial, const Step& step) const {
    double predicted = reduction(step.objective, step.violation);
    double ratio = -std::numeric_limits<double>::infinity();
    if (!at_trial.is_defined) return ratio;
    if (predicted > kLeastReduction) ratio = reduction(at_trial) / predicted;
    predicted = here().objective() - step.objective;
    const double violation = std::max(here().violation(), at_trial.violation());
    if (predicted > kLeastReduction && violation <= options_.tolerated)
      ratio = std::max(ratio, (here().objective() - at_trial.objective()) / predicted);
    return ratio;
  }

  double next_radius(const Trial& trial) const {
    const double length = trial.dx.lpNorm<Eigen::Infinity>();
    if (trial.gain_ratio < kShrink) return kShrunk * length;
    if (trial.gain_ratio > kGrow && length > kAtBound * at_.radius)
      return std::min(2 * at_.radius, kLargestRadius);
    return at_.radius;
  }

  bool is_stagnant(const std::vector<double>& violations) const {
    if (violations.size() <= kPatience) return false;
    const double before = violations[violations.size() - 1 - kPatience];
    return *std::min_element(violations.begin(), violations.end()) > options_.feasibility &&
           violations.back() > std::max(kSmallViolation, kStagnant * before);
  }

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

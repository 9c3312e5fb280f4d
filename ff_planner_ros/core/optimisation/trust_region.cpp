#include "optimisation/trust_region.hpp"

#include "optimisation/decompositions.hpp"

namespace ff {

Solution TrustRegionSolver::minimise() {
  Solution found;
  found.stop = here().is_defined ? descend(found) : Stop::kUndefined;
  found.end = std::move(at_);
  return found;
}

Stop TrustRegionSolver::descend(Solution& found) {
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

RowMajor TrustRegionSolver::convex_hessian() const {
  if (here().max_terms.size() == 0) return here().hessian;
  return semidefinite_part(here().hessian + at_.curvature);
}

Step TrustRegionSolver::step_and_penalty(const Functions& model,
                                         const std::optional<WorkingSet>& guess) {
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

Step TrustRegionSolver::solve(const Functions& model, double penalty,
                              const std::optional<WorkingSet>& guess, bool elastic) const {
  return solve_subproblem(model, at_.radius, penalty, options_.inside, guess, elastic);
}

std::optional<Stop> TrustRegionSolver::convergence(const Step& step, bool& converged) const {
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

TrustRegionSolver::Trial TrustRegionSolver::tried(const Step& step) const {
  const Trial trial = tried(step, step.dx);
  if (trial.gain_ratio >= kShrink || !trial.at_x->is_defined || here().equalities.size() == 0)
    return trial;
  Vector dx;
  if (options_.tolerated > 0) {
    // The shortest step that brings the equalities, as they are at the trial x, back to zero. It
    // looks at neither trust region nor constraints, and takes a tenth of a quadratic
    // subproblem's time. Where violations on the way are tolerated, plans are as good; elsewhere
    // it lost one that is hard to find.
    const Vector correction =
        shortest_solution(here().equalities_jacobian, -trial.at_x->equalities);
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

TrustRegionSolver::Trial TrustRegionSolver::tried(const Step& step, const Vector& dx) const {
  FunctionsAt at_trial = linearise_(at_.x + dx);
  const double ratio = gain_ratio(*at_trial, step);
  return {std::move(at_trial), dx, ratio};
}

double TrustRegionSolver::reduction(double objective, double violation) const {
  return (here().objective() - objective) + penalty_ * (here().violation() - violation);
}

double TrustRegionSolver::reduction(const Functions& after) const {
  return after.is_defined ? reduction(after.objective(), after.violation())
                          : -std::numeric_limits<double>::infinity();
}

double TrustRegionSolver::gain_ratio(const Functions& at_trial, const Step& step) const {
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

double TrustRegionSolver::next_radius(const Trial& trial) const {
  const double length = trial.dx.lpNorm<Eigen::Infinity>();
  if (trial.gain_ratio < kShrink) return kShrunk * length;
  if (trial.gain_ratio > kGrow && length > kAtBound * at_.radius)
    return std::min(2 * at_.radius, kLargestRadius);
  return at_.radius;
}

bool TrustRegionSolver::is_stagnant(const std::vector<double>& violations) const {
  if (violations.size() <= kPatience) return false;
  const double before = violations[violations.size() - 1 - kPatience];
  return *std::min_element(violations.begin(), violations.end()) > options_.feasibility &&
         violations.back() > std::max(kSmallViolation, kStagnant * before);
}

}  // namespace ff

#include "collision/body_certificate.hpp"

namespace ff {
namespace {

class Halving {
 public:
  Halving(DistancesOnTheWay& of, double gap, double part) : measured_(of), gap_(gap), part_(part) {}

  // The least of some numbers until a last point.
  double least(const std::vector<int>& numbers, int last) {
    // What seems nearest comes first: the rest need not be looked at so closely then.
    std::vector<std::pair<double, int>> order;
    for (const int number : numbers) {
      double nearest = kInfinite;
      for (int i = 0; i <= kLooks; ++i)
        nearest = std::min(nearest, measured_.bound(number, std::floor(i * last / double{kLooks})));
      order.emplace_back(nearest, number);
    }
    std::sort(order.begin(), order.end());
    for (const auto& [nearest, number] : order) {
      finest_ = std::max(gap_, kRounding * measured_.way(number, 0, last));
      halved_ = 0;
      End begin{measured_.bound(number, 0), false}, end{measured_.bound(number, last), false};
      halve(number, 0, last, begin, end);
    }
    return std::min(certified_, met_);
  }

 private:
  static constexpr int kLooks = 8;
  static constexpr double kRounding = 1e-14;  // of the whole way: nobody can tell more closely
  static constexpr int kMost = 1 << 14;       // halvings: ways that need more are no robot's
  struct End {
    double distance;  // or a lower bound of it
    bool is_exact;
  };

  void halve(int number, double begin, double end, End& at_begin, End& at_end) {
    const double way = measured_.way(number, begin, end);
    if (!settled(at_begin, at_end, way)) {
      measure(number, begin, at_begin);
      measure(number, end, at_end);
    }
    if (settled(at_begin, at_end, way)) {
      certified_ = std::min(certified_, (at_begin.distance + at_end.distance - way) / 2);
      return;
    }
    ++halved_;
    double middle = (begin + end) / 2;
    if (end - begin > 1) middle = std::floor(middle);
    End between{measured_.bound(number, middle), false};
    halve(number, begin, middle, at_begin, between);
    halve(number, middle, end, between, at_end);
  }
  bool settled(const End& begin, const End& end, double way) const {
    return (halved_ >= kMost && begin.is_exact && end.is_exact) ||
           (begin.distance + end.distance - way) / 2 >= met_ - std::max(finest_, part_ * met_);
  }
  void measure(int number, double step, End& end) {
    if (end.is_exact) return;
    end = {measured_.distance(number, step), true};
    if (!(end.distance < kInfinite)) throw std::domain_error("a distance is not finite");
    met_ = std::min(met_, end.distance);
  }

  DistancesOnTheWay& measured_;
  double gap_, part_;
  double finest_ = 0;  // that a bound is looked for to
  int halved_ = 0;     // pieces of the present number
  double met_ = kInfinite, certified_ = kInfinite;
};

}  // namespace

const BodiesOnTheWay::At& BodiesOnTheWay::at(double step) {
  const int point = static_cast<int>(step);
  if (step == point) {
    if (!at_points_[point]) at_points_[point] = made(step);
    return *at_points_[point];
  }
  const auto found = between_.find(step);
  return found != between_.end() ? found->second : between_.emplace(step, made(step)).first->second;
}

double BodiesOnTheWay::time(double step) const {
  const int point = before(step);
  return motion_.times[point] + (step - point) * (motion_.times[point + 1] - motion_.times[point]);
}

double BodiesOnTheWay::grown(const RowMajor& sums, double step, int column) const {
  const int point = before(step);
  return sums(point, column) + (step - point) * (sums(point + 1, column) - sums(point, column));
}

int BodiesOnTheWay::before(double step) const {
  return std::min(static_cast<int>(step), static_cast<int>(motion_.q.size()) - 2);
}

BodiesOnTheWay::At BodiesOnTheWay::made(double step) const {
  const int point = before(step);
  const Configuration q = step == point       ? motion_.q[point]
                          : step == point + 1 ? motion_.q[point + 1]
                                              : motion_.at(point, step - point);
  return {PlacedBodies(motion_.chain, of, q.joints), q.position,
          q.attitude.toRotationMatrix().transpose(), time(step)};
}

RowMajor sums_of(const Rows& ways) {
  RowMajor sums = RowMajor::Zero(ways.rows() + 1, ways.cols());
  for (int i = 0; i < ways.rows(); ++i) sums.row(i + 1) = sums.row(i) + ways.row(i);
  return sums;
}

double PairsOnTheWay::bound(int number, double step) {
  const auto [a, b] = bodies.of.pairs[number];
  const PlacedBodies& placed = bodies.at(step).placed;
  return (placed.centers[a] - placed.centers[b]).norm() - bodies.of.bodies[a].radius -
         bodies.of.bodies[b].radius;
}

double PairsOnTheWay::distance(int number, double step) {
  const auto [a, b] = bodies.of.pairs[number];
  const std::vector<Pose>& solids = bodies.at(step).placed.solids;
  return gap(bodies.of.bodies[a].solid, solids[a], bodies.of.bodies[b].solid, solids[b],
             known[number])
      .distance;
}

double PairsOnTheWay::way(int number, double begin, double end) const {
  return bodies.grown(ways, end, number) - bodies.grown(ways, begin, number);
}

double SpheresOnTheWay::bound(int number, double step) {
  const BodiesOnTheWay::At& at = bodies.at(step);
  return (at.placed.centers[body(number)] - at.center(sphere(number))).norm() -
         bodies.of.bodies[body(number)].radius - sphere(number).radius;
}

double SpheresOnTheWay::distance(int number, double step) {
  const BodiesOnTheWay::At& at = bodies.at(step);
  const Gap found = gap(bodies.of.bodies[body(number)].solid, at.placed.solids[body(number)],
                        at.center(sphere(number)));
  return found.distance - sphere(number).radius;
}

double SpheresOnTheWay::way(int number, double begin, double end) const {
  return bodies.grown(ways, end, body(number)) - bodies.grown(ways, begin, body(number)) +
         (bodies.time(end) - bodies.time(begin)) * sphere(number).highest_speed;
}

double certified_least(DistancesOnTheWay& of, const std::vector<int>& numbers, int last, double gap,
                       double part) {
  return Halving(of, gap, part).least(numbers, last);
}

}  // namespace ff

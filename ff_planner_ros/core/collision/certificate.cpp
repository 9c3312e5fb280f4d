#include "collision/certificate.hpp"

#include <optional>

#include "collision/ways.hpp"
#include "kinematics/rotation.hpp"

namespace ff {
namespace {

constexpr double kInfinite = std::numeric_limits<double>::infinity();

// The tangent step that leads from one configuration to another.
Velocity step_between(const Configuration& from, const Configuration& to) {
  const Eigen::Quaterniond back = from.attitude.conjugate();
  const Vector3 turn = turn_of_quaternion((back * to.attitude).normalized().coeffs());
  const AngleFunctions of(turn.squaredNorm());
  const Matrix3 moves = Matrix3::Identity() + of.b * skew(turn) + of.c * skew_square(turn);
  Velocity step(6 + from.joints.size());
  step << moves.inverse() * (back * (to.position - from.position)), turn, to.joints - from.joints;
  return step;
}

// Numbered distances along a motion. Times are steps: points, or parts of the way between two.
class DistancesOnTheWay {
 public:
  struct At {
    PlacedBodies placed;
    View view;
    double time;
  };

  DistancesOnTheWay(const CubicMotion& motion, const Bodies& bodies, const Ways& ways)
      : bodies_(bodies), ways_(ways), motion_(motion), at_points_(motion.q.size()) {}
  virtual ~DistancesOnTheWay() = default;

  // A lower bound of the distance, by spheres around both.
  virtual double bound(int number, double step) = 0;
  virtual double distance(int number, double step) = 0;
  // That both move against each other at most.
  virtual double way(int number, double begin, double end) const = 0;

 protected:
  // Where the bodies are, looked up once.
  const At& at(double step) {
    const int point = static_cast<int>(step);
    if (step != point) {
      const auto found = between_.find(step);
      return found != between_.end() ? found->second
                                     : between_.emplace(step, made(step)).first->second;
    }
    std::optional<At>& found = at_points_[point];
    if (!found) found.emplace(made(step));
    return *found;
  }
  double time(double step) const {
    const int point = before(step);
    const Eigen::VectorXd& times = motion_.times;
    return times[point] + (step - point) * (times[point + 1] - times[point]);
  }

  const Bodies& bodies_;
  const Ways ways_;

 private:
  int before(double step) const {
    return std::min(static_cast<int>(step), static_cast<int>(motion_.q.size()) - 2);
  }
  At made(double step) const {
    const int point = before(step);
    const Configuration q = step == point       ? motion_.q[point]
                            : step == point + 1 ? motion_.q[point + 1]
                                                : motion_.at(point, step - point);
    return {PlacedBodies(motion_.chain, bodies_, q.joints), View(q), time(step)};
  }

  const CubicMotion& motion_;
  std::vector<std::optional<At>> at_points_;
  std::map<double, At> between_;
};

class PairsOnTheWay : public DistancesOnTheWay {
 public:
  PairsOnTheWay(const CubicMotion& motion, const Bodies& bodies)
      : DistancesOnTheWay(motion, bodies, ways_of_pairs(motion, bodies)),
        known_(bodies.pairs.size()) {}

  double bound(int number, double step) override {
    const auto [a, b] = bodies_.pairs[number];
    const PlacedBodies& placed = at(step).placed;
    return (placed.centers[a] - placed.centers[b]).norm() - bodies_.bodies[a].radius -
           bodies_.bodies[b].radius;
  }
  double distance(int number, double step) override {
    const auto [a, b] = bodies_.pairs[number];
    const PlacedBodies& placed = at(step).placed;
    return gap(placed.solid(a), placed.poses[a], placed.solid(b), placed.poses[b], known_[number])
        .distance;
  }
  double way(int number, double begin, double end) const override {
    return ways_.between(begin, end, number);
  }

 private:
  std::vector<Simplex> known_;
};

class ObstaclesOnTheWay : public DistancesOnTheWay {
 public:
  ObstaclesOnTheWay(const CubicMotion& motion, const Bodies& bodies, const Obstacles& obstacles)
      : DistancesOnTheWay(motion, bodies, ways_of_bodies(motion, bodies)), obstacles_(obstacles) {
    const double until = motion.times[motion.times.size() - 1];
    std::map<const TumblingBody*, double> turns;
    for (const Obstacle& one : obstacles) {
      const auto [turn, is_new] = turns.try_emplace(one.body.get(), 0);
      if (is_new && one.body) turn->second = one.body->fastest_turn(until);
      speeds_.push_back(highest_speed(one, turn->second));
      if (!std::isfinite(speeds_.back()))
        throw std::invalid_argument("the speed of an obstacle is too great");
    }
  }

  double bound(int number, double step) override {
    const At& now = at(step);
    return ff::bound(now.placed.centers[body(number)], bodies_.bodies[body(number)].radius,
                     obstacle(number), seen(now, obstacle(number)));
  }
  double distance(int number, double step) override {
    const At& now = at(step);
    const Pose there = seen(now, obstacle(number));
    Simplex& known = known_[number];
    if (bodies_.bodies[body(number)].stretches()) known = {};
    return gap(now.placed.solid(body(number)), now.placed.poses[body(number)], obstacle(number),
               there, known)
        .distance;
  }
  double way(int number, double begin, double end) const override {
    const double speed = speeds_[number % speeds_.size()];
    return ways_.between(begin, end, body(number)) + (time(end) - time(begin)) * speed;
  }

 private:
  int body(int number) const { return number / static_cast<int>(obstacles_.size()); }
  const Obstacle& obstacle(int number) const { return obstacles_[number % obstacles_.size()]; }
  static Pose seen(const At& now, const Obstacle& obstacle) {
    return now.view.of(obstacle, obstacle.at(now.time));
  }

  const Obstacles& obstacles_;
  std::vector<double> speeds_;
  std::map<int, Simplex> known_;
};

class Halving {
 public:
  Halving(DistancesOnTheWay& of, const Asked& asked) : measured_(of), asked_(asked) {}

  double least() {
    // What seems nearest comes first: the rest need not be looked at so closely then.
    std::vector<std::pair<double, int>> order;
    for (const int number : asked_.numbers) {
      double nearest = kInfinite;
      for (int i = 0; i <= kLooks; ++i) {
        const double step = std::floor(i * asked_.last / double{kLooks});
        nearest = std::min(nearest, measured_.bound(number, step));
      }
      order.emplace_back(nearest, number);
    }
    std::sort(order.begin(), order.end());
    for (const auto& [nearest, number] : order) {
      finest_ = std::max(asked_.gap, kRounding * measured_.way(number, 0, asked_.last));
      halved_ = 0;
      End begin{measured_.bound(number, 0), false},
          end{measured_.bound(number, asked_.last), false};
      halve(number, 0, asked_.last, begin, end);
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
           (begin.distance + end.distance - way) / 2 >=
               met_ - std::max(finest_, asked_.part * met_);
  }
  void measure(int number, double step, End& end) {
    if (end.is_exact) return;
    end = {measured_.distance(number, step), true};
    if (!(end.distance < kInfinite)) throw std::domain_error("a distance is not finite");
    met_ = std::min(met_, end.distance);
  }

  DistancesOnTheWay& measured_;
  const Asked& asked_;
  double finest_ = 0;  // that a bound is looked for to
  int halved_ = 0;     // pieces of the present number
  double met_ = kInfinite, certified_ = kInfinite;
};

}  // namespace

CubicMotion::CubicMotion(const Chain& chain, std::vector<Configuration> at, const Rows& v,
                         const Values& times)
    : chain(chain), q(std::move(at)), cubics(3 * (q.size() - 1), v.cols()), times(times) {
  for (size_t i = 0; i + 1 < q.size(); ++i) {
    const double seconds = times[i + 1] - times[i];
    const Velocity whole = step_between(q[i], q[i + 1]), begin = seconds * v.row(i).transpose();
    Velocity end = seconds * v.row(i + 1).transpose();
    // Where it ends, the step changes at this rate.
    const Vector6 of_base = whole.head<6>(), twist = end.head<6>();
    end.head<6>() = exponential_derivative(of_base).partialPivLu().solve(twist);
    cubics.row(3 * i) = begin;
    cubics.row(3 * i + 1) = 3 * whole - 2 * begin - end;
    cubics.row(3 * i + 2) = begin + end - 2 * whole;
  }
}

Configuration CubicMotion::at(int point, double s) const {
  const Velocity moved = s * cubics.row(3 * point) + s * s * cubics.row(3 * point + 1) +
                         s * s * s * cubics.row(3 * point + 2);
  return q[point].step(moved);
}

double certified_pairs(const CubicMotion& motion, const Bodies& bodies, const Asked& asked) {
  PairsOnTheWay pairs(motion, bodies);
  return Halving(pairs, asked).least();
}

double certified_obstacles(const CubicMotion& motion, const Bodies& bodies,
                           const Obstacles& obstacles, const Asked& asked) {
  ObstaclesOnTheWay all(motion, bodies, obstacles);
  return Halving(all, asked).least();
}

}  // namespace ff

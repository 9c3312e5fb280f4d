// A lower bound of the distances of bodies along a whole motion, between its points too, while a
// search goes on. Times are steps here: points, or parts of the way between two.
#pragma once
#include <map>
#include <optional>

#include "collision/bodies.hpp"
#include "collision/certificate.hpp"

namespace ff {

// Where the bodies are along a motion, each step looked up once.
class BodiesOnTheWay {
 public:
  struct At {
    PlacedBodies placed;
    Vector3 base;
    Matrix3 to_base;
    double time;
    // As the chaser sees it.
    Vector3 center(const Sphere& sphere) const { return to_base * (sphere.center_at(time) - base); }
  };

  BodiesOnTheWay(const CubicMotion& motion, const Bodies& of)
      : of(of), motion_(motion), at_points_(motion.q.size()) {}

  const At& at(double step);
  double time(double step) const;
  // What has grown since the first point, in every interval by a row.
  double grown(const RowMajor& sums, double step, int column) const;

  const Bodies& of;

 private:
  int before(double step) const;
  At made(double step) const;

  const CubicMotion& motion_;
  std::vector<std::optional<At>> at_points_;
  std::map<double, At> between_;
};

// Sums of what bodies move in each interval, from the first point on.
RowMajor sums_of(const Rows& ways);

constexpr double kInfinite = std::numeric_limits<double>::infinity();

// Numbered distances along a motion.
struct DistancesOnTheWay {
  virtual ~DistancesOnTheWay() = default;
  // A lower bound of the distance, by spheres around both.
  virtual double bound(int number, double step) = 0;
  virtual double distance(int number, double step) = 0;
  // That both move against each other at most.
  virtual double way(int number, double begin, double end) const = 0;
};

// Pairs of bodies, by their numbers.
struct PairsOnTheWay : DistancesOnTheWay {
  BodiesOnTheWay& bodies;
  RowMajor ways;  // of a pair against each other, as in `sums_of`
  std::vector<Simplex> known;

  PairsOnTheWay(BodiesOnTheWay& bodies, RowMajor ways)
      : bodies(bodies), ways(std::move(ways)), known(bodies.of.pairs.size()) {}

  double bound(int number, double step) override;
  double distance(int number, double step) override;
  double way(int number, double begin, double end) const override;
};

// Bodies and spheres; the number is body times spheres plus sphere.
struct SpheresOnTheWay : DistancesOnTheWay {
  BodiesOnTheWay& bodies;
  RowMajor ways;  // of a body, as in `sums_of`
  const std::vector<Sphere>& spheres;

  SpheresOnTheWay(BodiesOnTheWay& bodies, RowMajor ways, const std::vector<Sphere>& spheres)
      : bodies(bodies), ways(std::move(ways)), spheres(spheres) {}

  const Sphere& sphere(int number) const { return spheres[number % spheres.size()]; }
  int body(int number) const { return number / static_cast<int>(spheres.size()); }

  double bound(int number, double step) override;
  double distance(int number, double step) override;
  double way(int number, double begin, double end) const override;
};

// The least of some numbered distances until a last point. In a piece of the motion a distance is
// at least the mean of both ends' less half the way. Pieces whose bound is too low to tell are
// halved, until it is within `gap` or `part` of the least, or until there are too many of them:
// then the bound is what it is.
double certified_least(DistancesOnTheWay& of, const std::vector<int>& numbers, int last, double gap,
                       double part);

}  // namespace ff

// Distances of the arm's segments from spheres that may move, with their derivatives: those that
// are near enough to be of interest.
#pragma once
#include <algorithm>
#include <limits>
#include <stdexcept>
#include <vector>

#include "collision/path.hpp"
#include "collision/sphere.hpp"
#include "kinematics/arm.hpp"

namespace ff {

// Joint origins nearer than this are the same point; drawings are not more exact [m].
constexpr double kSamePoint = 1e-6;

// A row of derivatives by the variables.
using Gradient = Eigen::Map<Eigen::RowVectorXd>;

// Where the arm is at some times.
class ArmMotion {
 public:
  ArmMotion(const Chain& chain, const Path& path);

  // Adds points a quarter of the way between those at points and three quarters, by parabolas
  // through both and the one half-way. The configurations are those at all points but the first,
  // then those half-way in every interval; the first interval is left out.
  void add_quarter_way();

  // Adds the derivative, along a direction, of the place a fraction of the way from point k to the
  // next; at: number of a time.
  void add_gradient(size_t at, int k, double fraction, const Vector3& direction, Gradient to) const;

  Eigen::Index variables() const { return path_.dq.cols(); }

  std::vector<ArmPoints> points;

 private:
  struct Parabola {
    int near, middle, far;
  };

  Path path_;
  std::vector<Arm> arms_;
  std::vector<Parabola> between_;
};

// Indices of the points that start a segment of some length, at any time.
std::vector<int> segments(const std::vector<ArmPoints>& points);

// Part of the way along a segment at which it is nearest to a point.
double nearest_part(const Vector3& to_point, const Vector3& along);

// Indices of the spheres within a distance from the box around all points: the broad phase. A
// sphere that moves is nearer than the box around its centre's way.
std::vector<int> near_box(const std::vector<ArmPoints>& points, const Values& times,
                          const std::vector<Sphere>& spheres, double distance);

struct ClearanceRows {
  std::vector<double> distances, jacobian;  // negative inside; a row a distance
  std::vector<long long> names;             // by point, the joint that starts a line, and sphere

  // Adds a distance that is of interest; returns its derivatives, which are zero so far.
  Gradient add(double distance, long long name, Eigen::Index columns);
};

// The distances below `interest`. The nearest point of a segment moves with the segment; its
// sliding along it does not change the distance to first order.
ClearanceRows clearance_rows(const ArmMotion& arm, const Times& times,
                             const std::vector<Sphere>& spheres, double interest);

}  // namespace ff

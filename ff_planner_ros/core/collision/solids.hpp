// Convex solids: how far a point is from one, how far two are apart (GJK), and how deep they are in
// each other (EPA).
#pragma once
#include <algorithm>
#include <limits>
#include <vector>

#include "collision/penetration.hpp"
#include "collision/simplex.hpp"

namespace ff {

// Of solids that come so near, their radii left out, GJK's direction is in the noise [m].
constexpr double kTouching = 1e-6;
// A shorter direction is none [m].
constexpr double kNoDirection = 1e-12;

struct Solid {
  // kRound is what is within a radius of a piece of the z axis: spheres and capsules.
  // Distances of a point from what comes before kHull have a closed form.
  enum Kind { kRound, kBox, kCylinder, kHull, kCone, kKinds };

  Kind kind;
  Vector3 sizes;                  // half edges; or radius, half length
  std::vector<Vector3> vertices;  // of a hull
  double grown = 0;               // to all sides: corners are round then

  // The solid is what is within this distance of its core.
  double radius() const { return (kind == kRound ? sizes[0] : 0) + grown; }

  // A sphere around the origin of its frame.
  bool is_sphere() const { return kind == kRound && sizes[1] == 0; }

  // The point of the core that is furthest in a direction.
  Vector3 support(const Vector3& direction) const;
};

struct Gap {
  double distance;        // negative: the shortest way that brings both apart
  Vector3 point, normal;  // on the line through both nearest points; from the first to the second
};

// The distance of a point from a box around the origin, and its gradient; both without signs.
template <int N>
double beyond_corner(const Eigen::Matrix<double, N, 1>& point,
                     const Eigen::Matrix<double, N, 1>& corner,
                     Eigen::Matrix<double, N, 1>& gradient) {
  const Eigen::Matrix<double, N, 1> beyond = point - corner;
  gradient = beyond.cwiseMax(0);
  const double length = gradient.norm();
  if (length > kNoDirection) {
    gradient /= length;
    return length;
  }
  int nearest;
  const double depth = beyond.maxCoeff(&nearest);
  gradient.setZero();
  gradient[nearest] = 1;
  return depth;
}

// Of two solids whose cores touch or are in each other.
Gap gap_inside(const Solid& first, const Pose& at, const Solid& second, const Pose& there);

// Gilbert, Johnson and Keerthi: the nearest points of two solids. `known` is where the search
// begins and ends: empty, or that of the same solids elsewhere. Solids that are surely further
// apart than `enough` need not be measured: the distance is a lower bound then, and greater.
Gap gap(const Solid& first, const Pose& at, const Solid& second, const Pose& there, Simplex& known,
        double enough = std::numeric_limits<double>::infinity());

// How far a point is from a solid; the normal leads out of it.
Gap gap(const Solid& solid, const Pose& at, const Vector3& point);

}  // namespace ff

// Convex solids: how far a point is from one, and how far two are apart (GJK).
#pragma once
#include <algorithm>
#include <limits>
#include <vector>

#include "spatial.hpp"

namespace ff {

// What two solids say that come so near, their radii left out, is in the noise [m].
constexpr double kTouching = 1e-6;
// A shorter direction is none [m].
constexpr double kNoDirection = 1e-12;

struct Solid {
  // kRound is what is within a radius of a piece of the z axis: spheres and capsules.
  enum Kind { kRound, kBox, kCylinder, kHull };

  Kind kind;
  Vector3 sizes;                  // half edges; or radius, half length
  std::vector<Vector3> vertices;  // of a hull

  // The solid is what is within this distance of its core.
  double radius() const { return kind == kRound ? sizes[0] : 0; }

  // The point of the core that is furthest in a direction.
  Vector3 support(const Vector3& direction) const {
    const auto signed_as = [](double size, double sign) { return sign < 0 ? -size : size; };
    switch (kind) {
      case kRound:
        return {0, 0, signed_as(sizes[1], direction.z())};
      case kBox:
        return {signed_as(sizes[0], direction.x()), signed_as(sizes[1], direction.y()),
                signed_as(sizes[2], direction.z())};
      case kCylinder: {
        const double across = std::hypot(direction.x(), direction.y());
        const double scale = across > kNoDirection ? sizes[0] / across : 0;
        return {scale * direction.x(), scale * direction.y(), signed_as(sizes[1], direction.z())};
      }
      default: {
        const Vector3* furthest = &vertices[0];
        double most = furthest->dot(direction);
        for (const Vector3& vertex : vertices) {
          const double along = vertex.dot(direction);
          if (along > most) most = along, furthest = &vertex;
        }
        return *furthest;
      }
    }
  }
};

struct Gap {
  double distance;
  Vector3 point, normal;  // on the line through both nearest points; from the first to the second
  bool is_known = true;   // not where the cores touch or are in each other
};

// The distance of a point from a box around the origin, and its gradient; both without signs.
template <int N>
Gap beyond_corner(const Eigen::Matrix<double, N, 1>& point, const Eigen::Matrix<double, N, 1>& corner,
                  Eigen::Matrix<double, N, 1>& gradient) {
  const Eigen::Matrix<double, N, 1> beyond = point - corner;
  gradient = beyond.cwiseMax(0);
  const double length = gradient.norm();
  if (length > kNoDirection) {
    gradient /= length;
    return {length, {}, {}};
  }
  int nearest;
  const double depth = beyond.maxCoeff(&nearest);
  gradient.setZero();
  gradient[nearest] = 1;
  return {depth, {}, {}};
}

// Closest point to the origin of a simplex, with the weights of its vertices; vertices without
// weight are dropped. Returns false where the origin is inside.
class Simplex {
 public:
  int size = 0;
  Vector3 difference[4];               // of points of both solids
  Vector3 on_first[4], on_second[4];   // these points, each in the frame of its solid
  double weight[4];

  void add(const Vector3& a, const Vector3& b, const Pose& first, const Pose& second) {
    on_first[size] = a, on_second[size] = b;
    difference[size++] = first * a - second * b;
  }
  // The same points of solids that have moved.
  void move(const Pose& first, const Pose& second) {
    for (int i = 0; i < size; ++i) difference[i] = first * on_first[i] - second * on_second[i];
  }
  Vector3 closest() const { return weighted(difference); }
  Vector3 on_first_solid() const { return weighted(on_first); }

  bool reduce() {
    switch (size) {
      case 1:
        weight[0] = 1;
        return true;
      case 2:
        take(segment(0, 1));
        return true;
      case 3:
        take(triangle(0, 1, 2));
        return true;
      default: {
        Part best;
        static constexpr int faces[4][4] = {{0, 1, 2, 3}, {0, 2, 3, 1}, {0, 3, 1, 2}, {1, 3, 2, 0}};
        for (const auto& [a, b, c, opposite] : faces) {
          const Vector3 normal =
              (difference[b] - difference[a]).cross(difference[c] - difference[a]);
          const double origin = -difference[a].dot(normal);
          const double inside = (difference[opposite] - difference[a]).dot(normal);
          if (origin * inside > 1e-24) continue;  // behind this face, as the fourth vertex is
          const Part part = triangle(a, b, c);
          if (part.square < best.square) best = part;
        }
        if (best.size == 0) return false;
        take(best);
        return true;
      }
    }
  }

 private:
  struct Part {
    double square = 1e300;
    int size = 0, vertex[3] = {};
    double weight[3] = {};
  };

  Vector3 weighted(const Vector3* of) const {
    Vector3 sum = Vector3::Zero();
    for (int i = 0; i < size; ++i) sum += weight[i] * of[i];
    return sum;
  }

  void take(const Part& part) {
    Vector3 d[3], a[3], b[3];
    for (int i = 0; i < part.size; ++i) {
      const int from = part.vertex[i];
      d[i] = difference[from], a[i] = on_first[from], b[i] = on_second[from];
    }
    size = part.size;
    for (int i = 0; i < size; ++i)
      difference[i] = d[i], on_first[i] = a[i], on_second[i] = b[i], weight[i] = part.weight[i];
  }

  Part point(int i) const {
    Part part;
    part.square = difference[i].squaredNorm();
    part.size = 1, part.vertex[0] = i, part.weight[0] = 1;
    return part;
  }

  Part segment(int i, int j) const {
    const Vector3 along = difference[j] - difference[i];
    const double square = along.squaredNorm();
    const double t = square > 0 ? -difference[i].dot(along) / square : 0;
    if (t <= 0) return point(i);
    if (t >= 1) return point(j);
    Part part;
    part.square = (difference[i] + t * along).squaredNorm();
    part.size = 2;
    part.vertex[0] = i, part.vertex[1] = j;
    part.weight[0] = 1 - t, part.weight[1] = t;
    return part;
  }

  Part triangle(int i, int j, int k) const {
    const Vector3 &a = difference[i], &b = difference[j], &c = difference[k];
    const Vector3 normal = (b - a).cross(c - a);
    const double square = normal.squaredNorm();
    const double u = b.cross(c).dot(normal), v = c.cross(a).dot(normal), w = a.cross(b).dot(normal);
    if (square > 1e-30 && u > 0 && v > 0 && w > 0) {
      Part part;
      part.size = 3;
      part.vertex[0] = i, part.vertex[1] = j, part.vertex[2] = k;
      const double sum = u + v + w;
      part.weight[0] = u / sum, part.weight[1] = v / sum, part.weight[2] = w / sum;
      part.square = (part.weight[0] * a + part.weight[1] * b + part.weight[2] * c).squaredNorm();
      return part;
    }
    Part best = segment(i, j);
    for (const Part& part : {segment(j, k), segment(k, i)})
      if (part.square < best.square) best = part;
    return best;
  }
};

// Gilbert, Johnson and Keerthi: the nearest points of two solids. `known` is where the search begins
// and ends: empty, or that of the same solids elsewhere. Solids that are surely further apart than
// `enough` need not be measured: the distance is a lower bound then, and greater.
inline Gap gap(const Solid& first, const Pose& at, const Solid& second, const Pose& there,
               Simplex& known, double enough = std::numeric_limits<double>::infinity()) {
  constexpr int kMost = 100;
  constexpr double kExact = 1e-10;  // of the distance [m]
  const double radii = first.radius() + second.radius();
  const auto support = [&](Simplex& simplex, const Vector3& direction) {
    simplex.add(first.support(at.rotation.transpose() * direction),
                second.support(there.rotation.transpose() * -direction), at, there);
  };
  if (known.size == 0)
    support(known, there.position - at.position);
  else
    known.move(at, there);
  known.reduce();
  Vector3 v = known.closest();
  double length = v.norm();
  Simplex simplex = known;
  for (int i = 0; i < kMost; ++i) {
    if (!(length > kTouching)) return {0, {}, {}, false};
    support(simplex, -v);
    const double least = v.dot(simplex.difference[simplex.size - 1]) / length;
    if (least - radii > enough) return {least - radii, at * known.on_first_solid(), -v / length};
    if (length - least <= kExact) break;
    if (!simplex.reduce()) return {0, {}, {}, false};
    const Vector3 closer = simplex.closest();
    if (!(closer.squaredNorm() < length * length)) break;
    v = closer;
    length = v.norm();
    known = simplex;
  }
  if (!(length > kTouching)) return {0, {}, {}, false};
  return {length - radii, at * known.on_first_solid(), -v / length};
}

// How far a point is from a solid; the normal leads out of it.
inline Gap gap(const Solid& solid, const Pose& at, const Vector3& point) {
  const Vector3 seen = at.rotation.transpose() * (point - at.position);
  Vector3 out;
  double distance;
  const auto sign = [](double of) { return of < 0 ? -1. : 1.; };
  switch (solid.kind) {
    case Solid::kRound: {
      out = seen - Vector3(0, 0, std::clamp(seen.z(), -solid.sizes[1], solid.sizes[1]));
      const double length = out.norm();
      distance = length - solid.sizes[0];
      out = length > kNoDirection ? Vector3(out / length) : Vector3::UnitX();
      break;
    }
    case Solid::kBox: {
      distance = beyond_corner<3>(seen.cwiseAbs(), solid.sizes, out).distance;
      for (int i = 0; i < 3; ++i) out[i] *= sign(seen[i]);
      break;
    }
    case Solid::kCylinder: {
      const double across = std::hypot(seen.x(), seen.y());
      Eigen::Vector2d gradient;
      distance = beyond_corner<2>({across, std::abs(seen.z())}, solid.sizes.head<2>(), gradient).distance;
      const Eigen::Vector2d radial =
          across > kNoDirection ? Eigen::Vector2d(seen.head<2>() / across) : Eigen::Vector2d(1, 0);
      out << gradient[0] * radial, gradient[1] * sign(seen.z());
      break;
    }
    default: {
      static const Solid origin{Solid::kRound, Vector3::Zero(), {}};
      Simplex nothing;
      Gap found = gap(solid, at, origin, {point, Matrix3::Identity()}, nothing);
      found.point = point;
      return found;
    }
  }
  return {distance, point, at.rotation * out};
}

}  // namespace ff

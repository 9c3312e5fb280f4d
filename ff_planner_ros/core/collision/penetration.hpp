// How deep two convex solids are in each other: the shortest way that brings them apart.
//
// A polytope grows inside their difference, by the point furthest out of its face next to the
// origin, until that face is one of the difference [van den Bergen, Proximity queries and
// penetration depth computation on 3D game objects, GDC 2001].
#pragma once
#include <algorithm>
#include <array>
#include <limits>
#include <optional>
#include <vector>

#include "kinematics/spatial.hpp"

namespace ff {

// A point of the difference of two solids, and the point of the first that it is made of.
struct DifferencePoint {
  Vector3 difference, on_first;
};

struct Penetration {
  double depth;
  Vector3 point, normal;  // of the first solid, where it is deepest; the second leaves it that way
};

// Support returns the point of the difference that is furthest in a direction.
template <typename Support>
class GrowingPolytope {
 public:
  explicit GrowingPolytope(const Support& support) : support_(support) {}

  Penetration penetration() {
    if (const std::optional<Vector3> thin = begin()) return across(*thin);
    // Of all directions that were looked at: each brings the solids apart.
    Penetration least{std::numeric_limits<double>::infinity(), {}, {}};
    for (;;) {
      const Face face = *std::min_element(
          faces_.begin(), faces_.end(),
          [](const Face& one, const Face& other) { return one.offset < other.offset; });
      const DifferencePoint beyond = support_(face.normal);
      const double depth = beyond.difference.dot(face.normal);
      if (depth - face.offset <= kExactDepth) return {depth, on_first(face), face.normal};
      const bool is_least = depth < least.depth;
      if (is_least) least = {depth, beyond.on_first, face.normal};
      if (points_.size() >= kMostPoints || !grow(beyond))
        return is_least ? Penetration{depth, on_first(face), face.normal} : least;
    }
  }

 private:
  static constexpr double kExactDepth = 1e-10;   // [m]
  static constexpr double kThin = 1e-9;          // what is thinner has no inside [m]
  static constexpr double kInPlane = 1e-12;      // a point less far out of a face lies in it [m]
  static constexpr double kSameFace = 1 - 1e-9;  // cosine of the angle between two normals
  static constexpr double kNoArea = 1e-20;       // a smaller triangle has no normal [m2]
  static constexpr size_t kMostPoints = 200;     // solids that need more are known well enough
  struct Face {
    std::array<int, 3> corners;  // anticlockwise, seen from outside
    Vector3 normal;
    double offset;  // of its plane from the origin; infinite where it is no triangle
  };

  const Vector3& at(int i) const { return points_[i].difference; }

  // Begins with a tetrahedron, or returns the direction in which the difference is thin.
  std::optional<Vector3> begin() {
    const Vector3 x = Vector3::UnitX(), y = Vector3::UnitY(), z = Vector3::UnitZ();
    points_ = {support_(x)};
    const Vector3 along =
        add_furthest<5>({-x, y, -y, z, -z}, [](const Vector3& way) { return way; });
    if (along.norm() <= kThin) return x;
    const Vector3 aside = along.unitOrthogonal(), other = along.normalized().cross(aside);
    const Vector3 out =
        add_furthest<4>({aside, -aside, other, -other}, [&](const Vector3& way) -> Vector3 {
          return aside.dot(way) * aside + other.dot(way) * other;
        });
    if (out.norm() <= kThin) return aside;
    const Vector3 normal = along.cross(out).normalized();
    const Vector3 up = add_furthest<2>(
        {normal, -normal}, [&](const Vector3& way) -> Vector3 { return normal.dot(way) * normal; });
    if (up.norm() <= kThin) return normal;
    const int b = up.dot(normal) > 0 ? 1 : 2, c = 3 - b;
    for (const auto& [i, j, k] :
         std::array<std::array<int, 3>, 4>{{{0, c, b}, {0, b, 3}, {b, c, 3}, {c, 0, 3}}})
      add_face(i, j, k);
    return std::nullopt;
  }

  // Of the points furthest in some directions, adds the one with the longest part of the way to it
  // from the first point; returns that part.
  template <size_t count, typename Part>
  Vector3 add_furthest(const std::array<Vector3, count>& directions, const Part& part) {
    Vector3 longest = Vector3::Zero();
    DifferencePoint furthest = points_[0];
    for (const Vector3& direction : directions) {
      const DifferencePoint found = support_(direction);
      const Vector3 way = part(found.difference - at(0));
      if (way.norm() <= longest.norm()) continue;
      longest = way;
      furthest = found;
    }
    points_.push_back(furthest);
    return longest;
  }

  // Of a difference that is thin in a direction.
  Penetration across(const Vector3& thin) const {
    const Vector3 other = -thin;
    const DifferencePoint up = support_(thin), down = support_(other);
    const double depth = up.difference.dot(thin), depth_down = down.difference.dot(other);
    if (depth_down < depth) return {depth_down, down.on_first, other};
    return {depth, up.on_first, thin};
  }

  void add_face(int i, int j, int k) {
    const Vector3 normal = (at(j) - at(i)).cross(at(k) - at(i));
    const double area = normal.norm();
    if (area > kNoArea)
      faces_.push_back({{i, j, k}, normal / area, normal.dot(at(i)) / area});
    else
      faces_.push_back({{i, j, k}, Vector3::Zero(), std::numeric_limits<double>::infinity()});
  }

  // Weights of the corners of a face in the point of its plane next to the origin.
  Vector3 weights(const Face& face) const {
    const Vector3 nearest = face.offset * face.normal;
    const auto between = [&](int j, int k) {
      return (at(j) - nearest).cross(at(k) - nearest).dot(face.normal);
    };
    const auto& [i, j, k] = face.corners;
    const Vector3 parts(between(j, k), between(k, i), between(i, j));
    return parts / parts.sum();
  }

  // The point of the first solid that belongs to that point: a face of several triangles has one in
  // which it lies.
  Vector3 on_first(const Face& nearest) const {
    const Face* around = &nearest;
    Vector3 within = weights(nearest);
    for (const Face& face : faces_) {
      if (face.normal.dot(nearest.normal) < kSameFace) continue;
      const Vector3 found = weights(face);
      if (!(found.minCoeff() > within.minCoeff())) continue;
      within = found;
      around = &face;
    }
    const auto& [i, j, k] = around->corners;
    return within[0] * points_[i].on_first + within[1] * points_[j].on_first +
           within[2] * points_[k].on_first;
  }

  // Replaces the faces that a point is outside of; false if it is outside of all, or if the surface
  // is torn and its faces multiply, as only rounding makes them.
  bool grow(const DifferencePoint& by) {
    std::vector<std::array<int, 2>> rim;
    const auto seen = [&](const Face& face) {
      if (!(by.difference.dot(face.normal) - face.offset > kInPlane)) return false;
      for (int i = 0; i < 3; ++i) {
        const int from = face.corners[i], to = face.corners[(i + 1) % 3];
        const auto other = std::find(rim.begin(), rim.end(), std::array{to, from});
        if (other != rim.end())
          rim.erase(other);
        else
          rim.push_back({from, to});
      }
      return true;
    };
    faces_.erase(std::remove_if(faces_.begin(), faces_.end(), seen), faces_.end());
    const int added = static_cast<int>(points_.size());
    points_.push_back(by);
    for (const auto& [from, to] : rim) add_face(from, to, added);
    // A closed surface has fewer than two faces a point.
    return !rim.empty() && faces_.size() <= 4 * points_.size();
  }

  const Support& support_;
  std::vector<DifferencePoint> points_;
  std::vector<Face> faces_;
};

}  // namespace ff

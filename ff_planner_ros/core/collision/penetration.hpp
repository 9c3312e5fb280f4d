// How deep two convex solids are in each other: the shortest way that brings them apart.
//
// A polytope grows inside their difference, by the point furthest out of its face next to the
// origin, until that face is one of the difference [van den Bergen, Proximity queries and
// penetration depth computation on 3D game objects, GDC 2001].
#pragma once
#include <algorithm>
#include <array>
#include <cmath>
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
  // likely: ways out that are looked at where the polytope does not reach the depth.
  GrowingPolytope(const Support& support, std::vector<Vector3> likely)
      : support_(support), likely_(std::move(likely)) {}

  Penetration penetration() {
    if (const std::optional<Vector3> thin = begin()) return across(*thin);
    // Of all directions that were looked at: each brings the solids apart.
    Penetration least{std::numeric_limits<double>::infinity(), at(0), Vector3::UnitX()};
    for (;;) {
      Face& face = *std::min_element(
          faces_.begin(), faces_.end(),
          [](const Face& one, const Face& other) { return one.offset < other.offset; });
      if (face.offset == kNotAsked) return turned(least);
      const DifferencePoint beyond = support_(face.normal);
      const double depth = beyond.difference.dot(face.normal);
      const bool is_exact = depth - face.offset <= kExactDepth;
      if (is_exact && depth <= least.depth + kExactDepth)
        return {depth, on_first(face), face.normal};
      if (depth < least.depth) least = {depth, beyond.on_first, face.normal};
      if (is_exact || points_.size() >= kMostPoints) return turned(least);
      if (is_corner(beyond))
        face.offset = kNotAsked;  // rounding alone has its corner outside of it
      else
        grow(beyond, face);
    }
  }

 private:
  static constexpr double kExactDepth = 1e-10;   // [m]
  static constexpr double kThin = 1e-9;          // what is thinner has no inside [m]
  static constexpr double kInPlane = 1e-12;      // a point less far out of a face lies in it [m]
  static constexpr double kSameFace = 1 - 1e-9;  // cosine of the angle between two normals
  static constexpr double kNoArea = 1e-20;       // a smaller triangle has no normal [m2]
  static constexpr double kSamePoint = 1e-9;     // points that are nearer are one [m]
  static constexpr size_t kMostPoints = 200;     // of solids that need more, one face is looked at
  // From the least direction others are tried, at first as far away as one of so many points is
  // from the next, then ever nearer [rad]: by a golden angle each, so that few are all around.
  static constexpr double kFirstTurn = 0.03, kLeastTurn = 1e-10, kGoldenAngle = 2.39996323;
  static constexpr int kMostTurns = 500, kAround = 6;
  // The offset of what is not looked beyond: no triangle, or one with nothing beyond it.
  static constexpr double kNotAsked = std::numeric_limits<double>::infinity();
  using Edge = std::array<int, 2>;  // from corner to corner
  struct Face {
    std::array<int, 3> corners;  // anticlockwise, seen from outside
    Vector3 normal;
    double offset;         // of its plane from the origin
    bool is_seen = false;  // from the point that is to be added

    std::array<Edge, 3> edges() const {
      const auto& [i, j, k] = corners;
      return {{{i, j}, {j, k}, {k, i}}};
    }
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

  // The least of the directions around the least one so far, likely ones among them.
  Penetration turned(Penetration least) const {
    const auto try_way = [&](const Vector3& way) {
      const DifferencePoint beyond = support_(way);
      const double depth = beyond.difference.dot(way);
      if (!(depth < least.depth)) return false;
      least = {depth, beyond.on_first, way};
      return true;
    };
    for (const Vector3& way : likely_)
      if (way.norm() > 0) try_way(way.normalized());
    double angle = kFirstTurn;
    for (int turn = 0, in_vain = 0; turn < kMostTurns && angle > kLeastTurn; ++turn) {
      const Vector3 aside = least.normal.unitOrthogonal(), other = least.normal.cross(aside);
      const double to = turn * kGoldenAngle;
      if (try_way(
              (least.normal + angle * (std::cos(to) * aside + std::sin(to) * other)).normalized()))
        angle *= 2;
      else if (++in_vain % kAround == 0)
        angle /= 2;
    }
    return least;
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
      faces_.push_back({{i, j, k}, Vector3::Zero(), kNotAsked});
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

  bool is_corner(const DifferencePoint& one) const {
    return std::any_of(points_.begin(), points_.end(), [&](const DifferencePoint& other) {
      return (one.difference - other.difference).norm() <= kSamePoint;
    });
  }

  // Replaces the faces that a point is outside of, `first` among them.
  void grow(const DifferencePoint& by, Face& first) {
    for (Face& face : faces_)
      face.is_seen = by.difference.dot(face.normal) - face.offset > kInPlane;
    first.is_seen = true;
    std::vector<Edge> rim = rim_of_seen();
    if (!is_ring(rim)) {
      see_one_piece(first);
      rim = rim_of_seen();
    }
    faces_.erase(
        std::remove_if(faces_.begin(), faces_.end(), [](const Face& face) { return face.is_seen; }),
        faces_.end());
    const int added = static_cast<int>(points_.size());
    points_.push_back(by);
    for (const auto& [from, to] : rim) add_face(from, to, added);
  }

  std::vector<Edge> rim_of_seen() const {
    std::vector<Edge> rim;
    for (const Face& face : faces_)
      if (face.is_seen) add_to(rim, face);
    return rim;
  }

  static void add_to(std::vector<Edge>& rim, const Face& face) {
    for (const auto& [from, to] : face.edges()) {
      const auto other = std::find(rim.begin(), rim.end(), Edge{to, from});
      if (other != rim.end())
        rim.erase(other);
      else
        rim.push_back({from, to});
    }
  }

  // Whether edges lead round once, and meet no corner twice.
  static bool is_ring(const std::vector<Edge>& rim) {
    if (rim.empty()) return false;
    Edge at = rim[0];
    for (size_t length = 1; length < rim.size(); ++length) {
      at = *std::find_if(rim.begin(), rim.end(), [&](const Edge& of) { return of[0] == at[1]; });
      if (at[1] == rim[0][0]) return length + 1 == rim.size();
    }
    return false;
  }

  // Leaves those that are one piece with a face, and have no hole: rounding sees others where faces
  // nearly lie in one plane, and without these the surface would be torn.
  void see_one_piece(Face& first) {
    std::vector<Face*> others;
    for (Face& face : faces_)
      if (face.is_seen && &face != &first) others.push_back(&face);
    for (Face* face : others) face->is_seen = false;
    std::vector<Edge> rim;
    add_to(rim, first);
    const auto borders = [&](const Face& face) {
      int edges = 0, corners = 0;
      for (const auto& [from, to] : face.edges())
        for (const Edge& of : rim) {
          edges += of == Edge{to, from};
          corners += of[0] == from;
        }
      return edges > 0 && corners == edges + 1;
    };
    for (bool is_larger = true; is_larger;) {
      is_larger = false;
      for (Face* face : others)
        if (!face->is_seen && borders(*face)) {
          face->is_seen = is_larger = true;
          add_to(rim, *face);
        }
    }
  }

  const Support& support_;
  const std::vector<Vector3> likely_;
  std::vector<DifferencePoint> points_;
  std::vector<Face> faces_;
};

}  // namespace ff

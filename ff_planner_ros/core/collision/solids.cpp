#include "collision/solids.hpp"

#include "kinematics/deadline.hpp"

namespace ff {

Vector3 Solid::support(const Vector3& direction) const {
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
    case kCone: {  // its apex, or a point of the rim
      const double across = std::hypot(direction.x(), direction.y());
      if (2 * sizes[1] * direction.z() > sizes[0] * across) return {0, 0, sizes[1]};
      const double scale = across > kNoDirection ? sizes[0] / across : 0;
      return {scale * direction.x(), scale * direction.y(), -sizes[1]};
    }
    default: {
      const Vector3* furthest = &vertices[0];
      double most = furthest->dot(direction);
      for (const Vector3& vertex : vertices) {
        const double along = vertex.dot(direction);
        if (along > most) {
          most = along;
          furthest = &vertex;
        }
      }
      return *furthest;
    }
  }
}

Gap gap_inside(const Solid& first, const Pose& at, const Solid& second, const Pose& there) {
  Deadline::require();
  const auto furthest = [&](const Vector3& direction) -> DifferencePoint {
    const Vector3 on_first = at * first.support(at.rotation.transpose() * direction);
    return {on_first - there * second.support(there.rotation.transpose() * -direction), on_first};
  };
  // What is round about its z axis often leaves across it.
  const Vector3 way = there.position - at.position;
  const Vector3 axis = at.rotation.col(2), other = there.rotation.col(2), both = axis.cross(other);
  const std::vector<Vector3> likely = {way - axis.dot(way) * axis, way - other.dot(way) * other,
                                       both, -both};
  const Penetration found = GrowingPolytope(furthest, likely).penetration();
  return {-found.depth - first.radius() - second.radius(), found.point, found.normal};
}

Gap gap(const Solid& first, const Pose& at, const Solid& second, const Pose& there, Simplex& known,
        double enough) {
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
    if (!(length > kTouching)) return gap_inside(first, at, second, there);
    support(simplex, -v);
    const double least = v.dot(simplex.newest()) / length;
    if (least - radii > enough) return {least - radii, at * known.on_first_solid(), -v / length};
    if (length - least <= kExact) break;
    if (!simplex.reduce()) return gap_inside(first, at, second, there);
    const Vector3 closer = simplex.closest();
    if (!(closer.squaredNorm() < length * length)) break;
    v = closer;
    length = v.norm();
    known = simplex;
  }
  if (!(length > kTouching)) return gap_inside(first, at, second, there);
  return {length - radii, at * known.on_first_solid(), -v / length};
}

Gap gap(const Solid& solid, const Pose& at, const Vector3& point) {
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
      distance = beyond_corner<3>(seen.cwiseAbs(), solid.sizes, out);
      for (int i = 0; i < 3; ++i) out[i] *= sign(seen[i]);
      break;
    }
    case Solid::kCylinder: {
      const double across = std::hypot(seen.x(), seen.y());
      Eigen::Vector2d gradient;
      distance = beyond_corner<2>({across, std::abs(seen.z())}, solid.sizes.head<2>(), gradient);
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
  return {distance - solid.grown, point, at.rotation * out};
}

}  // namespace ff

#include "collision/bodies.hpp"

#include "kinematics/deadline.hpp"

namespace ff {

PlacedBodies::PlacedBodies(const Chain& chain, const Bodies& of, const Joints& joints)
    : origins(3, chain.joints()), axes(3, chain.joints()), slides(3, chain.joints()) {
  std::array<Pose, kMaxJoints + 1> links;
  links[0] = {Vector3::Zero(), Matrix3::Identity()};
  for (int k = 0; k < chain.joints(); ++k) {
    links[k + 1] = links[k] * chain.placements[k];
    origins.col(k) = links[k + 1].position;
    axes.col(k) = links[k + 1].rotation * chain.axes[k];
    slides.col(k) = links[k + 1].rotation * chain.slides[k];
    links[k + 1] = chain.moved(links[k + 1], k, joints[k]);
  }
  solids.reserve(of.bodies.size());
  centers.reserve(of.bodies.size());
  for (const Body& body : of.bodies) {
    const Pose& link = links[body.carriers];
    solids.push_back(link * body.placement);
    centers.push_back(link.position + link.rotation * body.center);
  }
  tip = (links[chain.joints()] * chain.tip).position;
}

double PlacedBodies::along(const Gap& found, int k) const {
  const Vector3 moved = axes.col(k).cross(found.point - origins.col(k)) + slides.col(k);
  return found.normal.dot(moved);
}

Velocity PlacedBodies::gradient(const Gap& found, int carriers) const {
  Velocity by_q(6 + carriers);
  by_q.head<6>() = -stack(found.normal, found.point.cross(found.normal));
  for (int k = 0; k < carriers; ++k) by_q[6 + k] = -along(found, k);
  return by_q;
}

double apart(const Eigen::AlignedBox3d& a, const Eigen::AlignedBox3d& b) {
  return (a.min() - b.max()).cwiseMax(b.min() - a.max()).cwiseMax(0).norm();
}

BodiesAlong::BodiesAlong(const Chain& chain, const Bodies& of, DensePath along)
    : of(of), path(std::move(along)), ways(of.bodies.size()) {
  at.reserve(path.q.rows());
  placed.reserve(path.q.rows());
  for (Eigen::Index i = 0; i < path.q.rows(); ++i) {
    Deadline::require();
    at.push_back(Configuration::read(path.q.row(i)));
    placed.emplace_back(chain, of, at[i].joints);
    for (size_t body = 0; body < ways.size(); ++body)
      ways[body].extend(at[i].position + at[i].attitude * placed[i].centers[body]);
  }
}

bool counts(double distance, double interest) {
  if (std::isnan(distance)) throw std::domain_error("a distance is not a number");
  return distance < interest;
}

ClearanceRows pair_rows(const BodiesAlong& along, double interest) {
  ClearanceRows rows;
  const Bodies& of = along.of;
  const int pairs = static_cast<int>(of.pairs.size());
  std::vector<Simplex> known(of.pairs.size());
  for (size_t i = 0; i < along.placed.size(); ++i) {
    Deadline::require();
    const PlacedBodies& placed = along.placed[i];
    RowMajor by_x;
    for (int number = 0; number < pairs; ++number) {
      const auto [a, b] = of.pairs[number];
      const Body &first = of.bodies[a], &second = of.bodies[b];
      const double around = first.radius + second.radius + interest;
      if ((placed.centers[a] - placed.centers[b]).squaredNorm() >= around * around) continue;
      const Gap found = gap(first.solid, placed.solids[a], second.solid, placed.solids[b],
                            known[number], interest);
      const long long name = static_cast<long long>(i) * pairs + number;
      if (!counts(found.distance, interest)) continue;
      if (by_x.size() == 0) by_x = along.path.derivatives(i);
      auto row = rows.add(found.distance, name, by_x.cols());
      const double sign = first.carriers < second.carriers ? 1 : -1;
      for (int k = std::min(first.carriers, second.carriers);
           k < std::max(first.carriers, second.carriers); ++k)
        row += sign * placed.along(found, k) * by_x.row(6 + k);
    }
  }
  return rows;
}

ClearanceRows sphere_rows(const BodiesAlong& along, const Times& times,
                          const std::vector<Sphere>& spheres, double interest) {
  ClearanceRows rows;
  const Bodies& of = along.of;
  const int bodies = static_cast<int>(of.bodies.size());
  std::vector<std::vector<int>> near(bodies);
  std::vector<bool> is_near(spheres.size(), false);  // any of the bodies
  for (size_t sphere = 0; sphere < spheres.size(); ++sphere) {
    const Eigen::AlignedBox3d way = spheres[sphere].way(times.at);
    for (int body = 0; body < bodies; ++body)
      if (apart(along.ways[body], way) <
          of.bodies[body].radius + spheres[sphere].radius + interest) {
        near[body].push_back(static_cast<int>(sphere));
        is_near[sphere] = true;
      }
  }
  std::vector<Vector3> centers(spheres.size());
  for (size_t i = 0; i < along.placed.size(); ++i) {
    Deadline::require();
    const PlacedBodies& placed = along.placed[i];
    const Matrix3 to_base = along.at[i].attitude.toRotationMatrix().transpose();
    RowMajor by_x;
    for (size_t sphere = 0; sphere < spheres.size(); ++sphere)
      if (is_near[sphere])
        centers[sphere] = to_base * (spheres[sphere].center_at(times.at[i]) - along.at[i].position);
    for (int body = 0; body < bodies; ++body)
      for (const int sphere : near[body]) {
        const Body& solid = of.bodies[body];
        const Vector3& center = centers[sphere];
        const double around = solid.radius + spheres[sphere].radius + interest;
        if ((placed.centers[body] - center).squaredNorm() >= around * around) continue;
        const Gap found = gap(solid.solid, placed.solids[body], center);
        const double distance = found.distance - spheres[sphere].radius;
        const long long name =
            (static_cast<long long>(i) * bodies + body) * static_cast<long long>(spheres.size()) +
            sphere;
        if (!counts(distance, interest)) continue;
        if (by_x.size() == 0) by_x = along.path.derivatives(i);
        auto row = rows.add(distance, name, by_x.cols());
        const Velocity by_q = placed.gradient(found, solid.carriers);
        row.noalias() = by_q.transpose() * by_x.topRows(by_q.size());
        if (times.by_last.size() > 0)
          row[row.size() - 1] +=
              times.by_last[i] *
              found.normal.dot(to_base * spheres[sphere].velocity_at(times.at[i]));
      }
  }
  return rows;
}

}  // namespace ff

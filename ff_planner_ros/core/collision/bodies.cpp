#include "collision/bodies.hpp"

#include <algorithm>
#include <functional>

#include "kinematics/deadline.hpp"

namespace ff {

PlacedBodies::PlacedBodies(const Chain& chain, const Bodies& of, const Joints& joints)
    : of(of), origins(3, chain.joints()), axes(3, chain.joints()), slides(3, chain.joints()) {
  std::array<Pose, kMaxJoints + 1> links;
  links[0] = {Vector3::Zero(), Matrix3::Identity()};
  for (int k = 0; k < chain.joints(); ++k) {
    links[k + 1] = links[k] * chain.placements[k];
    origins.col(k) = links[k + 1].position;
    axes.col(k) = links[k + 1].rotation * chain.axes[k];
    slides.col(k) = links[k + 1].rotation * chain.slides[k];
    links[k + 1] = chain.moved(links[k + 1], k, joints[k]);
  }
  poses.reserve(of.bodies.size());
  centers.reserve(of.bodies.size());
  for (const Body& body : of.bodies) {
    const Pose& link = links[body.carriers];
    poses.push_back(link * body.placement);
    centers.push_back(link.position + link.rotation * body.center);
  }
  if (std::any_of(of.bodies.begin(), of.bodies.end(), std::mem_fn(&Body::stretches)))
    for (size_t number = 0; number < of.bodies.size(); ++number) {
      const Body& body = of.bodies[number];
      lines_.push_back(body.solid);
      if (!body.stretches()) continue;
      const Pose& link = links[body.carriers];
      const Vector3 end = 2 * body.center + joints[body.carriers] * body.slide;
      const auto turned = Eigen::Quaterniond::FromTwoVectors(Vector3::UnitZ(), end);
      lines_.back().sizes[1] = end.norm() / 2;
      centers[number] = link * (end / 2);
      poses[number] = {centers[number], link.rotation * turned.toRotationMatrix()};
    }
  tip = (links[chain.joints()] * chain.tip).position;
}

double PlacedBodies::along(const Gap& found, int k) const {
  const Vector3 moved = axes.col(k).cross(found.point - origins.col(k)) + slides.col(k);
  return found.normal.dot(moved);
}

Velocity PlacedBodies::gradient(const Gap& found, int body) const {
  const int carriers = of.bodies[body].carriers;
  const bool stretches = of.bodies[body].stretches();
  Velocity by_q(6 + carriers + stretches);
  by_q.head<6>() = -stack(found.normal, found.point.cross(found.normal));
  for (int k = 0; k < carriers; ++k) by_q[6 + k] = -along(found, k);
  if (!stretches) return by_q;
  // A place on a line moves by that part of the way of its end.
  const double half_length = solid(body).sizes[1];
  const double from_center = poses[body].rotation.col(2).dot(found.point - centers[body]);
  const double part = std::clamp(from_center / std::max(half_length, kNoDirection), -1.0, 1.0);
  by_q[6 + carriers] = -(1 + part) / 2 * found.normal.dot(slides.col(carriers));
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

Eigen::Map<Eigen::RowVectorXd> DistanceRows::add(double distance, long long name,
                                                 Eigen::Index columns) {
  distances.push_back(distance);
  names.push_back(name);
  jacobian.resize(jacobian.size() + columns, 0.);
  return {jacobian.data() + jacobian.size() - columns, columns};
}

bool counts(double distance, double interest) {
  if (std::isnan(distance)) throw std::domain_error("a distance is not a number");
  return distance < interest;
}

DistanceRows pair_rows(const BodiesAlong& along, double interest) {
  DistanceRows rows;
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
      const Gap found =
          gap(first.solid, placed.poses[a], second.solid, placed.poses[b], known[number], interest);
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

}  // namespace ff

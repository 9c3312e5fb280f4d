#include "collision/bodies.hpp"

#include <algorithm>
#include <functional>

#include "kinematics/deadline.hpp"

namespace ff {

PlacedBodies::PlacedBodies(const Chain& chain, const Bodies& of, const Joints& joints)
    : of(of),
      tree(chain.tree),
      origins(3, tree->joints()),
      axes(3, tree->joints()),
      slides(3, tree->joints()) {
  const Joints positions = tree->positions(joints);
  std::array<Pose, kMaxJoints + 1> links;
  links[0] = {Vector3::Zero(), Matrix3::Identity()};
  for (int k = 0; k < tree->joints(); ++k) {
    links[k + 1] = links[tree->before[k]] * chain.placements[k];
    origins.col(k) = links[k + 1].position;
    axes.col(k) = links[k + 1].rotation * chain.axes[k];
    slides.col(k) = links[k + 1].rotation * chain.slides[k];
    links[k + 1] = chain.moved(links[k + 1], k, positions[k]);
  }
  poses.reserve(of.bodies.size());
  centers.reserve(of.bodies.size());
  for (const Body& body : of.bodies) {
    const Pose& link = links[body.link];
    poses.push_back(link * body.placement);
    centers.push_back(link.position + link.rotation * body.center);
  }
  if (std::any_of(of.bodies.begin(), of.bodies.end(), std::mem_fn(&Body::stretches)))
    for (size_t number = 0; number < of.bodies.size(); ++number) {
      const Body& body = of.bodies[number];
      lines_.push_back(body.solid);
      if (!body.stretches()) continue;
      const Pose& link = links[body.link];
      const Vector3 end = 2 * body.center + positions[tree->to_tip(body.link)] * body.slide;
      const auto turned = Eigen::Quaterniond::FromTwoVectors(Vector3::UnitZ(), end);
      lines_.back().sizes[1] = end.norm() / 2;
      centers[number] = link * (end / 2);
      poses[number] = {centers[number], link.rotation * turned.toRotationMatrix()};
    }
  tip = (links[tree->tip] * chain.tip).position;
}

double PlacedBodies::along(const Gap& found, int k) const {
  const Vector3 moved = axes.col(k).cross(found.point - origins.col(k)) + slides.col(k);
  return tree->drives[k].multiplier * found.normal.dot(moved);
}

Velocity PlacedBodies::gradient(const Gap& found, int body) const {
  const int link = of.bodies[body].link;
  const bool stretches = of.bodies[body].stretches();
  const int count = tree->is_chain() ? link + stretches : tree->planned;
  Velocity by_q(6 + count);
  by_q.head<6>() = -stack(found.normal, found.point.cross(found.normal));
  by_q.tail(count).setZero();
  for (const int k : tree->moving(link)) by_q[6 + tree->drives[k].planned] -= along(found, k);
  if (!stretches) return by_q;
  // A place on a line moves by that part of the way of its end.
  const double half_length = solid(body).sizes[1];
  const double from_center = poses[body].rotation.col(2).dot(found.point - centers[body]);
  const double part = std::clamp(from_center / std::max(half_length, kNoDirection), -1.0, 1.0);
  const int next = tree->to_tip(link);
  const Tree::Drive& drive = tree->drives[next];
  by_q[6 + drive.planned] -= drive.multiplier * (1 + part) / 2 * found.normal.dot(slides.col(next));
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
      const Tree& tree = *placed.tree;
      const auto add = [&](double sign, const Body& moved, const Body& other) {
        for (const int k : tree.moving(moved.link))
          if (!tree.moves(k, other.link))
            row += sign * placed.along(found, k) * by_x.row(6 + tree.drives[k].planned);
      };
      add(1, second, first);
      add(-1, first, second);
    }
  }
  return rows;
}

}  // namespace ff

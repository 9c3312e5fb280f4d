#include "program/distance_requirements.hpp"

namespace ff {

void Margins::subtract_from(std::vector<double>& distances, const std::vector<long long>& names,
                            const Eigen::VectorXd& times) const {
  const long long pairs = room.size();
  const double until = gained * times.maxCoeff();
  for (size_t row = 0; row < distances.size(); ++row) {
    double least = room[names[row] % pairs];
    if (least < little * margin) {
      const long long at = names[row] / pairs;
      if (at >= times.size()) throw std::domain_error("there are more pairs than at the start");
      const double part = std::min(times[at] / until, 1.0);
      least += margin * (part * part * part);
    }
    distances[row] -= std::min(margin, least);
  }
}

void AllowedContacts::require_fits(Eigen::Index configurations) const {
  bool fits = goal.rows() == 0 || goal.rows() == configurations;
  for (const AtStart& of : at_start) fits = fits && of.places.rows() == configurations;
  if (!fits) throw std::invalid_argument("allowed contacts are those of another number of points");
}

ClearanceRows AllowedContacts::without(ClearanceRows rows, const BodiesAlong& along,
                                       Eigen::Index count) const {
  struct Apart {
    Eigen::Index since, until;  // not at this one any more
  };
  const Eigen::Index all = along.path.q.rows(), until = near_goal_from(along);
  std::vector<Apart> apart(count, {0, all});
  for (const int pair : pairs) apart[pair] = {0, until};
  for (const AtStart& of : at_start) {
    const Apart part{away_from(of, along), until};
    for (const int pair : of.pairs) apart[pair] = part;
  }
  const Eigen::Index columns = along.path.variables();
  size_t kept = 0;
  for (size_t row = 0; row < rows.names.size(); ++row) {
    const long long name = rows.names[row], at = name / count;
    const Apart& must = apart[name % count];
    if (at < must.since || at >= must.until) continue;
    rows.distances[kept] = rows.distances[row];
    rows.names[kept] = name;
    const auto from = rows.jacobian.begin() + row * columns;
    std::copy(from, from + columns, rows.jacobian.begin() + kept * columns);
    ++kept;
  }
  rows.distances.resize(kept);
  rows.names.resize(kept);
  rows.jacobian.resize(kept * columns);
  return rows;
}

bool AllowedContacts::is_away(const Vector3& tip, const RowMajor& places, Eigen::Index i) const {
  return (tip - places.row(i).transpose()).norm() > distance;
}

Eigen::Index AllowedContacts::near_goal_from(const BodiesAlong& along) const {
  Eigen::Index from = along.path.q.rows();
  if (goal.rows() == 0) return from;
  while (from > 0 && !is_away(along.tip(from - 1), goal, from - 1)) --from;
  return from;
}

Eigen::Index AllowedContacts::away_from(const AtStart& of, const BodiesAlong& along) const {
  const auto tip = [&](Eigen::Index i) {
    return of.seen_from_base ? along.placed[i].tip : along.tip(i);
  };
  Eigen::Index first = 0;
  while (first < along.path.q.rows() && !is_away(tip(first), of.places, first)) ++first;
  return first;
}

ConstraintRows taken(ClearanceRows& rows) {
  return {std::move(rows.distances), std::move(rows.jacobian), std::move(rows.names)};
}

Eigen::Index configurations(Eigen::Index points, bool quarter_way) {
  const Eigen::Index gaps = points - 1;
  return 2 * gaps + (quarter_way ? 2 * (gaps - 1) : 0);
}

void DistancesKept::require_fits(Eigen::Index, Eigen::Index points) const {
  require(times.size() == configurations(points, quarter_way),
          "times are those of another number of points");
}

Eigen::VectorXd DistancesKept::times_by_last(const PathMotion& motion) const {
  if (!motion.has_duration()) return {};
  return times / times.maxCoeff();
}

ConstraintRows DistancesKept::kept(ClearanceRows found) const {
  margins.subtract_from(found.distances, found.names, times);
  return taken(found);
}

void LinesClearOfSpheres::require_fits(Eigen::Index joints, Eigen::Index points) const {
  DistancesKept::require_fits(joints, points);
  require(margins.room.size() == joints * static_cast<Eigen::Index>(spheres->size()),
          "room is that of other lines and spheres");
}

ConstraintRows LinesClearOfSpheres::rows(const LookedAt& at) const {
  ArmMotion arm(at.chain, at.path());
  if (quarter_way) arm.add_quarter_way();
  const Eigen::VectorXd by_last = times_by_last(at.motion);
  return kept(clearance_rows(arm, {view(times), view(by_last)}, *spheres, interest));
}

void BodiesWithContacts::require_fits(Eigen::Index joints, Eigen::Index configurations) const {
  for (const Body& body : all->bodies)
    if (body.carriers > joints) throw std::invalid_argument("bodies are of another chain");
  if (allowed) allowed->require_fits(configurations);
}

ClearanceRows BodiesWithContacts::without_allowed(ClearanceRows rows, const BodiesAlong& along,
                                                  Eigen::Index pairs) const {
  return allowed ? allowed->without(std::move(rows), along, pairs) : rows;
}

void BodiesClear::require_fits(Eigen::Index joints, Eigen::Index points) const {
  DistancesKept::require_fits(joints, points);
  bodies.require_fits(joints, times.size());
}

ConstraintRows BodiesClear::rows(const LookedAt& at) const {
  const BodiesAlong& along = at.bodies(*bodies.all, quarter_way);
  const Eigen::VectorXd by_last = times_by_last(at.motion);
  ClearanceRows found = measured(along, {view(times), view(by_last)});
  return kept(bodies.without_allowed(std::move(found), along, margins.room.size()));
}

ClearanceRows BodiesClearOfSpheres::measured(const BodiesAlong& along, const Times& at) const {
  return sphere_rows(along, at, *spheres, interest);
}

ClearanceRows BodiesClearOfObstacles::measured(const BodiesAlong& along, const Times& at) const {
  return obstacle_rows(along, at, *obstacles, interest);
}

void PairsApart::require_fits(Eigen::Index joints, Eigen::Index points) const {
  bodies.require_fits(joints, configurations(points, quarter_way));
}

ConstraintRows PairsApart::rows(const LookedAt& at) const {
  const BodiesAlong& along = at.bodies(*bodies.all, quarter_way);
  const Eigen::Index pairs = margins.size();
  ClearanceRows found = bodies.without_allowed(pair_rows(along, interest), along, pairs);
  for (size_t row = 0; row < found.distances.size(); ++row)
    found.distances[row] -= margins[found.names[row] % pairs];
  return taken(found);
}

}  // namespace ff

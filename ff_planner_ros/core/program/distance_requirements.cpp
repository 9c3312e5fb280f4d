#include "program/distance_requirements.hpp"

namespace ff {

namespace {

// A room below this fraction of the margin grows, and has grown in this fraction of the duration.
constexpr double kLittle = 0.5, kGained = 0.25;

ConstraintRows taken(DistanceRows& rows) {
  return {std::move(rows.distances), std::move(rows.jacobian), std::move(rows.names)};
}

}  // namespace

void Margins::subtract_from(DistanceRows& rows, const Eigen::VectorXd& times) const {
  const long long pairs = room.size();
  const double until = kGained * times.maxCoeff();
  for (size_t row = 0; row < rows.distances.size(); ++row) {
    double least = room[rows.names[row] % pairs];
    if (least < kLittle * margin) {
      const double part = std::min(times[rows.names[row] / pairs] / until, 1.0);
      least += margin * (part * part * part);
    }
    rows.distances[row] -= std::min(margin, least);
  }
}

void AllowedContacts::require_fits(Eigen::Index configurations) const {
  bool fits = goal.rows() == 0 || goal.rows() == configurations;
  for (const AtStart& of : at_start) fits = fits && of.places.rows() == configurations;
  if (!fits) throw std::invalid_argument("allowed contacts are those of another number of points");
}

DistanceRows AllowedContacts::without(DistanceRows rows, const BodiesAlong& along,
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

void BodiesApart::require_fits(const Tree& tree, Eigen::Index points) const {
  for (const Body& body : bodies->bodies) require(body.fits(tree), "bodies are of another chain");
  if (allowed) allowed->require_fits(configurations(points));
}

Eigen::Index BodiesApart::configurations(Eigen::Index points) const {
  const Eigen::Index gaps = points - 1;
  return 2 * gaps + (quarter_way ? 2 * (gaps - 1) : 0);
}

DistanceRows BodiesApart::apart(DistanceRows rows, const LookedAt& at, Eigen::Index pairs) const {
  return allowed ? allowed->without(std::move(rows), along(at), pairs) : rows;
}

void BodiesClear::require_fits(const Tree& tree, Eigen::Index points) const {
  BodiesApart::require_fits(tree, points);
  require(times.size() == configurations(points), "times are those of another number of points");
}

ConstraintRows BodiesClear::rows(const LookedAt& at) const {
  // The last of the times is the duration, where that is a variable.
  Eigen::VectorXd by_last;
  if (at.motion.has_duration()) by_last = times / times.maxCoeff();
  DistanceRows found = obstacle_rows(along(at), {view(times), view(by_last)}, *obstacles, interest);
  found = apart(std::move(found), at, margins.room.size());
  margins.subtract_from(found, times);
  return taken(found);
}

ConstraintRows PairsApart::rows(const LookedAt& at) const {
  const Eigen::Index pairs = margins.size();
  DistanceRows found = apart(pair_rows(along(at), interest), at, pairs);
  for (size_t row = 0; row < found.distances.size(); ++row)
    found.distances[row] -= margins[found.names[row] % pairs];
  return taken(found);
}

}  // namespace ff

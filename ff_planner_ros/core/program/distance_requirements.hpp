// Distances along a path: of lines and bodies from what is in the way, and of bodies from each
// other.
#pragma once
#include "collision/obstacles.hpp"
#include "program/path_requirement.hpp"

namespace ff {

// The margins that distances must keep: no more than the room at the start. A much smaller room
// grows to the margin as the cube of the time.
struct Margins {
  double margin;         // the largest [m]
  Eigen::VectorXd room;  // of each pair, by its number [m]
  double little;         // a room below this fraction of the margin grows,
  double gained;         // and has grown in this fraction of the duration

  // names: configuration times the number of pairs, plus pair; times: of the configurations.
  void subtract_from(std::vector<double>& distances, const std::vector<long long>& names,
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
};

// What may touch, as a tool that closes on what it grasps, or lets go of it: pairs near the goal,
// from where the end effector comes near it for the last time; and those that touch at the start
// until it has first left its place there.
struct AllowedContacts {
  struct AtStart {
    std::vector<int> pairs;  // by their numbers; they may touch near the goal, too
    RowMajor places;  // of the end effector as if it had not moved yet; a row a configuration [m]
    bool seen_from_base;  // whether the places are in the base frame, not in the inertial one
  };

  std::vector<int> pairs;  // by their numbers; near the goal only
  RowMajor goal;    // its place, a row a configuration [m]; none: it has no place to touch at
  double distance;  // within which a place is near [m]
  std::vector<AtStart> at_start;

  // Throws where a path has another number of configurations.
  void require_fits(Eigen::Index configurations) const {
    bool fits = goal.rows() == 0 || goal.rows() == configurations;
    for (const AtStart& of : at_start) fits = fits && of.places.rows() == configurations;
    if (!fits)
      throw std::invalid_argument("allowed contacts are those of another number of points");
  }

  // Leaves out rows of pairs that may touch; names: configuration times the number of pairs, plus
  // pair.
  ClearanceRows without(ClearanceRows rows, const BodiesAlong& along, Eigen::Index count) const {
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

 private:
  bool is_away(const Vector3& tip, const RowMajor& places, Eigen::Index i) const {
    return (tip - places.row(i).transpose()).norm() > distance;
  }

  // The first configuration from which on the end effector stays near the goal.
  Eigen::Index near_goal_from(const BodiesAlong& along) const {
    Eigen::Index from = along.path.q.rows();
    if (goal.rows() == 0) return from;
    while (from > 0 && !is_away(along.tip(from - 1), goal, from - 1)) --from;
    return from;
  }

  // The first one at which it is not near its place at the start.
  Eigen::Index away_from(const AtStart& of, const BodiesAlong& along) const {
    const auto tip = [&](Eigen::Index i) {
      return of.seen_from_base ? along.placed[i].tip : along.tip(i);
    };
    Eigen::Index first = 0;
    while (first < along.path.q.rows() && !is_away(tip(first), of.places, first)) ++first;
    return first;
  }
};

inline ConstraintRows taken(ClearanceRows& rows) {
  return {std::move(rows.distances), std::move(rows.jacobian), std::move(rows.names)};
}

// How many configurations of a path distances are measured at: as `Path` and `DensePath` have them.
inline Eigen::Index configurations(Eigen::Index points, bool quarter_way) {
  const Eigen::Index gaps = points - 1;
  return 2 * gaps + (quarter_way ? 2 * (gaps - 1) : 0);
}

// Distances from obstacles that a requirement asks for.
struct DistancesKept : PathRequirement {
  Margins margins;
  Eigen::VectorXd times;  // of the configurations at which they are measured [s]
  double interest;        // [m]
  bool quarter_way;       // whether those include quarters of the intervals

  void require_fits(Eigen::Index, Eigen::Index points) const override {
    require(times.size() == configurations(points, quarter_way),
            "times are those of another number of points");
  }
  // Of the times by the last variable, where that is the duration: the last of the times.
  Eigen::VectorXd times_by_last(const PathMotion& motion) const {
    if (!motion.has_duration()) return {};
    return times / times.maxCoeff();
  }
  ConstraintRows kept(ClearanceRows found) const {
    margins.subtract_from(found.distances, found.names, times);
    return taken(found);
  }
};

// Of the arm's centre lines, which have the numbers of joints, from spheres.
struct LinesClearOfSpheres : DistancesKept {
  std::shared_ptr<const std::vector<Sphere>> spheres;

  void require_fits(Eigen::Index joints, Eigen::Index points) const override {
    DistancesKept::require_fits(joints, points);
    require(margins.room.size() == joints * static_cast<Eigen::Index>(spheres->size()),
            "room is that of other lines and spheres");
  }
  ConstraintRows rows(const LookedAt& at) const override {
    ArmMotion arm(at.chain, at.path());
    if (quarter_way) arm.add_quarter_way();
    const Eigen::VectorXd by_last = times_by_last(at.motion);
    return kept(clearance_rows(arm, {view(times), view(by_last)}, *spheres, interest));
  }
};

// Bodies of the robot, and what contacts of theirs are allowed.
struct BodiesWithContacts {
  std::shared_ptr<const Bodies> all;
  std::shared_ptr<const AllowedContacts> allowed;  // none: nothing may touch

  void require_fits(Eigen::Index joints, Eigen::Index configurations) const {
    for (const Body& body : all->bodies)
      if (body.carriers > joints) throw std::invalid_argument("bodies are of another chain");
    if (allowed) allowed->require_fits(configurations);
  }
  ClearanceRows without_allowed(ClearanceRows rows, const BodiesAlong& along,
                                Eigen::Index pairs) const {
    return allowed ? allowed->without(std::move(rows), along, pairs) : rows;
  }
};

// Of the robot's bodies from spheres, from other obstacles, and from each other.
struct BodiesClear : DistancesKept {
  BodiesWithContacts bodies;

  void require_fits(Eigen::Index joints, Eigen::Index points) const override {
    DistancesKept::require_fits(joints, points);
    bodies.require_fits(joints, times.size());
  }
  ConstraintRows rows(const LookedAt& at) const override {
    const BodiesAlong& along = at.bodies(*bodies.all, quarter_way);
    const Eigen::VectorXd by_last = times_by_last(at.motion);
    ClearanceRows found = measured(along, {view(times), view(by_last)});
    return kept(bodies.without_allowed(std::move(found), along, margins.room.size()));
  }

 private:
  virtual ClearanceRows measured(const BodiesAlong& along, const Times& at) const = 0;
};

struct BodiesClearOfSpheres : BodiesClear {
  std::shared_ptr<const std::vector<Sphere>> spheres;

 private:
  ClearanceRows measured(const BodiesAlong& along, const Times& at) const override {
    return sphere_rows(along, at, *spheres, interest);
  }
};

struct BodiesClearOfObstacles : BodiesClear {
  std::shared_ptr<const std::vector<Obstacle>> obstacles;

 private:
  ClearanceRows measured(const BodiesAlong& along, const Times& at) const override {
    return obstacle_rows(along, at, *obstacles, interest);
  }
};

struct PairsApart : PathRequirement {
  BodiesWithContacts bodies;
  Eigen::VectorXd margins;  // of each pair [m]
  double interest;          // [m]
  bool quarter_way;

  void require_fits(Eigen::Index joints, Eigen::Index points) const override {
    bodies.require_fits(joints, configurations(points, quarter_way));
  }
  ConstraintRows rows(const LookedAt& at) const override {
    const BodiesAlong& along = at.bodies(*bodies.all, quarter_way);
    const Eigen::Index pairs = margins.size();
    ClearanceRows found = bodies.without_allowed(pair_rows(along, interest), along, pairs);
    for (size_t row = 0; row < found.distances.size(); ++row)
      found.distances[row] -= margins[found.names[row] % pairs];
    return taken(found);
  }
};

}  // namespace ff

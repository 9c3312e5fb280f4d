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
                     const Eigen::VectorXd& times) const;
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
  void require_fits(Eigen::Index configurations) const;

  // Leaves out rows of pairs that may touch; names: configuration times the number of pairs, plus
  // pair.
  ClearanceRows without(ClearanceRows rows, const BodiesAlong& along, Eigen::Index count) const;

 private:
  bool is_away(const Vector3& tip, const RowMajor& places, Eigen::Index i) const;

  // The first configuration from which on the end effector stays near the goal.
  Eigen::Index near_goal_from(const BodiesAlong& along) const;

  // The first one at which it is not near its place at the start.
  Eigen::Index away_from(const AtStart& of, const BodiesAlong& along) const;
};

ConstraintRows taken(ClearanceRows& rows);

// How many configurations of a path distances are measured at: as `Path` and `DensePath` have them.
Eigen::Index configurations(Eigen::Index points, bool quarter_way);

// Distances from obstacles that a requirement asks for.
struct DistancesKept : PathRequirement {
  Margins margins;
  Eigen::VectorXd times;  // of the configurations at which they are measured [s]
  double interest;        // [m]
  bool quarter_way;       // whether those include quarters of the intervals

  void require_fits(Eigen::Index, Eigen::Index points) const override;
  // Of the times by the last variable, where that is the duration: the last of the times.
  Eigen::VectorXd times_by_last(const PathMotion& motion) const;
  ConstraintRows kept(ClearanceRows found) const;
};

// Of the arm's centre lines, which have the numbers of joints, from spheres.
struct LinesClearOfSpheres : DistancesKept {
  std::shared_ptr<const std::vector<Sphere>> spheres;

  void require_fits(Eigen::Index joints, Eigen::Index points) const override;
  ConstraintRows rows(const LookedAt& at) const override;
};

// Bodies of the robot, and what contacts of theirs are allowed.
struct BodiesWithContacts {
  std::shared_ptr<const Bodies> all;
  std::shared_ptr<const AllowedContacts> allowed;  // none: nothing may touch

  void require_fits(Eigen::Index joints, Eigen::Index configurations) const;
  ClearanceRows without_allowed(ClearanceRows rows, const BodiesAlong& along,
                                Eigen::Index pairs) const;
};

// Of the robot's bodies from spheres, from other obstacles, and from each other.
struct BodiesClear : DistancesKept {
  BodiesWithContacts bodies;

  void require_fits(Eigen::Index joints, Eigen::Index points) const override;
  ConstraintRows rows(const LookedAt& at) const override;

 private:
  virtual ClearanceRows measured(const BodiesAlong& along, const Times& at) const = 0;
};

struct BodiesClearOfSpheres : BodiesClear {
  std::shared_ptr<const std::vector<Sphere>> spheres;

 private:
  ClearanceRows measured(const BodiesAlong& along, const Times& at) const override;
};

struct BodiesClearOfObstacles : BodiesClear {
  std::shared_ptr<const std::vector<Obstacle>> obstacles;

 private:
  ClearanceRows measured(const BodiesAlong& along, const Times& at) const override;
};

struct PairsApart : PathRequirement {
  BodiesWithContacts bodies;
  Eigen::VectorXd margins;  // of each pair [m]
  double interest;          // [m]
  bool quarter_way;

  void require_fits(Eigen::Index joints, Eigen::Index points) const override;
  ConstraintRows rows(const LookedAt& at) const override;
};

}  // namespace ff

// Distances along a path: of bodies from what is in the way, and from each other.
#pragma once
#include "collision/obstacles.hpp"
#include "program/path_requirement.hpp"

namespace ff {

// The margins that distances must keep: no more than the room at the start. A much smaller room
// grows to the margin as the cube of the time.
struct Margins {
  double margin;         // the largest [m]
  Eigen::VectorXd room;  // of each pair, by its number [m]

  // names: configuration times the number of pairs, plus pair; times: of the configurations.
  void subtract_from(DistanceRows& rows, const Eigen::VectorXd& times) const;
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
  DistanceRows without(DistanceRows rows, const BodiesAlong& along, Eigen::Index count) const;

 private:
  bool is_away(const Vector3& tip, const RowMajor& places, Eigen::Index i) const;

  // The first configuration from which on the end effector stays near the goal.
  Eigen::Index near_goal_from(const BodiesAlong& along) const;

  // The first one at which it is not near its place at the start.
  Eigen::Index away_from(const AtStart& of, const BodiesAlong& along) const;
};

// Bodies of the robot, and what contacts of theirs are allowed.
struct BodiesApart : PathRequirement {
  std::shared_ptr<const Bodies> bodies;
  std::shared_ptr<const AllowedContacts> allowed;  // none: nothing may touch
  double interest;                                 // [m]
  bool quarter_way;  // whether distances are measured at quarters of the intervals, too

  void require_fits(const Tree& tree, Eigen::Index points) const override;

 protected:
  // How many configurations of a path they are measured at.
  Eigen::Index configurations(Eigen::Index points) const;
  const BodiesAlong& along(const LookedAt& at) const { return at.bodies(*bodies, quarter_way); }
  // Without contacts that are allowed.
  DistanceRows apart(DistanceRows rows, const LookedAt& at, Eigen::Index pairs) const;
};

// From obstacles.
struct BodiesClear : BodiesApart {
  std::shared_ptr<const Obstacles> obstacles;
  Margins margins;
  Eigen::VectorXd times;  // of the configurations, ascending [s]

  void require_fits(const Tree& tree, Eigen::Index points) const override;
  ConstraintRows rows(const LookedAt& at) const override;
};

// From each other.
struct PairsApart : BodiesApart {
  Eigen::VectorXd margins;  // of each pair [m]

  ConstraintRows rows(const LookedAt& at) const override;
};

}  // namespace ff

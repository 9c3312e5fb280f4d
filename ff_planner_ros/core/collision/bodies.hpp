// Distances of a robot's bodies from each other, with their derivatives: those that are near enough
// to be of interest. All of it as the chaser sees it.
#pragma once
#include <array>
#include <utility>
#include <vector>

#include "collision/path.hpp"
#include "collision/solids.hpp"

namespace ff {

struct Body {
  int link;        // the one of the chain's bodies that it is fixed to
  Pose placement;  // in the frame of that
  Vector3 center;  // likewise, of a sphere around it
  double radius;   // of that sphere
  Solid solid;
  // A line from that frame to where the next joint to the tip slides: how its end moves with that.
  Vector3 slide = Vector3::Zero();

  bool stretches() const { return !slide.isZero(0); }
  bool fits(const Tree& tree) const {
    return link <= tree.joints() && (!stretches() || tree.leads_to_tip(link));
  }
};

struct Bodies {
  std::vector<Body> bodies;
  std::vector<std::pair<int, int>> pairs;  // that must not touch
};

// Distances that are of interest, with their derivatives by a path's variables.
struct DistanceRows {
  std::vector<double> distances, jacobian;  // negative inside; a row a distance
  std::vector<long long> names;             // by configuration, then pair

  // Adds one; returns its derivatives, which are zero so far.
  Eigen::Map<Eigen::RowVectorXd> add(double distance, long long name, Eigen::Index columns);
};

// Where joints and bodies are at some joint angles.
struct PlacedBodies {
  const Bodies& of;
  std::shared_ptr<const Tree> tree;
  Matrix3J origins, axes, slides;  // of the joints
  std::vector<Pose> poses;         // of the bodies; likewise centres
  std::vector<Vector3> centers;
  Vector3 tip;  // of the end effector

  PlacedBodies(const Chain& chain, const Bodies& of, const Joints& joints);

  // Points of one that stretches are no longer its own at other joint angles.
  const Solid& solid(int body) const {
    return lines_.empty() ? of.bodies[body].solid : lines_[body];
  }

  // How fast the planned joint that drives joint k so moves what that carries along the normal.
  double along(const Gap& found, int k) const;

  // The derivatives of a body's distance from what is no part of the robot, by the tangent of the
  // configuration. Seen from a chaser that moves, that moves the other way.
  Velocity gradient(const Gap& found, int body) const;

 private:
  std::vector<Solid> lines_;  // of all bodies, if some of them stretch
};

// How far two boxes are apart. Eigen's own function branches at every axis, unpredictably.
double apart(const Eigen::AlignedBox3d& a, const Eigen::AlignedBox3d& b);

// Where the bodies are along a path.
struct BodiesAlong {
  const Bodies& of;
  DensePath path;
  std::vector<Configuration> at;
  std::vector<PlacedBodies> placed;
  std::vector<Eigen::AlignedBox3d> ways;  // of each body's centre, in the inertial frame

  BodiesAlong(const Chain& chain, const Bodies& of, DensePath along);

  // Where the end effector is, in the inertial frame.
  Vector3 tip(size_t i) const { return at[i].position + at[i].attitude * placed[i].tip; }
};

// Tells whether a distance is of interest.
bool counts(double distance, double interest);

// Named by configuration, then pair. Only joints that move one of two bodies alone move it against
// the other.
DistanceRows pair_rows(const BodiesAlong& along, double interest);

}  // namespace ff

// A chaser with one arm of joints that turn or slide: its model, its configurations, and how it
// looks from the base at some joint positions.
#pragma once
#include <array>
#include <vector>

#include "kinematics/rigid_motion.hpp"

namespace ff {

// Matrices with a row or a column a joint have room for so many, and need no memory of the heap.
constexpr int kMaxJoints = 64;
constexpr int kMaxVelocities = 6 + kMaxJoints;

using Joints = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxJoints, 1>;
using Velocity = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxVelocities, 1>;
using Matrix3J = Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, kMaxJoints>;
using Matrix6J = Eigen::Matrix<double, 6, Eigen::Dynamic, 0, 6, kMaxJoints>;
using MatrixJJ = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxJoints, kMaxJoints>;

// Derivatives of a vector, a column a variable.
using Matrix3X = Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::RowMajor>;

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
// Arrays that Python owns: a row, or a block of rows, a point.
using Rows = Eigen::Map<const RowMajor>;
using RowsToFill = Eigen::Map<RowMajor>;
using Values = Eigen::Map<const Eigen::VectorXd>;

// As Eigen's `allFinite`, in half its time: infinity less itself is no number.
bool are_finite(const Values& numbers);

// How the chaser can move: freely; in the plane of x and y, turning about z; or without turning,
// because wheels take up the angular momentum.
enum class Base { kFree, kPlanar, kHeld };

// Pinocchio's model of the robot as arrays. Bodies are numbered from the base, which is 0.
struct Chain {
  std::vector<Pose> placements;   // of each joint, in the frame of the joint before
  std::vector<Vector3> axes;      // of each joint, unit length, in its own frame; zero if it slides
  std::vector<Vector3> slides;    // where each joint slides to, likewise; zero if it turns
  Joints weights;                 // share of each joint in the joint path [1 or rad/m]
  std::vector<double> masses;     // of each body
  std::vector<Vector3> centers;   // of mass of each body, in the frame of its joint
  std::vector<Matrix3> inertias;  // of each body about its centre of mass
  Pose tip;                       // of the end effector, in the frame of the last joint

  int joints() const { return static_cast<int>(axes.size()); }
  // The frame of a joint, by an angle [rad] or a way [m] from where it is at zero.
  Pose moved(const Pose& at, int joint, double by) const;
};

struct Configuration {
  Vector3 position;             // of the base
  Eigen::Quaterniond attitude;  // base to inertial
  Joints joints;

  // Reads a row as Pinocchio writes it: position, quaternion xyzw, joints.
  static Configuration read(const Eigen::Ref<const Eigen::RowVectorXd>& q);
  void write(Eigen::Ref<Eigen::RowVectorXd> q) const;
  // Where the tangent step `by` leads.
  Configuration step(const Velocity& by) const;
};

// The chain at some joint angles, in the frame of the base.
struct Posture {
  Matrix6J screws;  // S_k: motion of what is beyond joint k, per rate
  std::array<Inertia, kMaxJoints + 1> body;
  std::array<Inertia, kMaxJoints + 1> composite;  // I^c_k: of body k and all beyond
  Pose tip;

  Posture(const Chain& chain, const Joints& joints);
};

}  // namespace ff

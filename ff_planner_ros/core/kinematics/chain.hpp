// A chaser with one arm of joints that turn or slide: its model, its configurations, and how it
// looks from the base at some joint positions.
//
// Joints that mimic one of the arm move along with it, in the arm or beside it. Whatever depends on
// joints is found for each by itself first, and then for those that are planned.
#pragma once
#include <array>
#include <memory>
#include <vector>

#include "kinematics/rigid_motion.hpp"

namespace ff {

// Matrices with a row or a column a joint have room for so many, and need no memory of the heap.
constexpr int kMaxJoints = 64;
constexpr int kMaxVelocities = 6 + kMaxJoints;

using Joints = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxJoints, 1>;
using JointRow = Eigen::Matrix<double, 1, Eigen::Dynamic, Eigen::RowMajor, 1, kMaxJoints>;
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

// What carries each joint, and what moves it. Joint k carries body k + 1; the base is body 0. They
// are numbered depth first: what a body carries comes next after it.
class Tree {
 public:
  // A joint is at multiplier times the position of a planned joint, plus an offset [rad, m].
  struct Drive {
    int planned;
    double multiplier, offset;
  };

  std::vector<int> before;    // the body that carries each joint
  std::vector<Drive> drives;  // of each joint
  int planned;                // number of joints that move by themselves
  int tip;                    // the body that the end effector is on

  Tree(std::vector<int> before, std::vector<Drive> drives, int planned, int tip);

  int joints() const { return static_cast<int>(before.size()); }
  // Whether each joint moves by itself, and carries the next one.
  bool is_chain() const { return is_chain_; }
  // The joints that move a body, from the base outwards.
  const std::vector<int>& moving(int body) const { return moving_[body]; }
  bool moves(int joint, int body) const { return joint < body && body <= last_[joint + 1]; }
  bool moves_tip(int joint) const { return moves(joint, tip); }
  bool leads_to_tip(int body) const {
    return body != tip && (moving_[body].empty() || moves_tip(moving_[body].back()));
  }
  // The joint on a body that leads to the tip.
  int to_tip(int body) const { return moving_[tip][moving_[body].size()]; }
  // How many bodies a body carries.
  int beyond(int body) const { return last_[body] - body; }

  // Of all joints, by those of the planned ones.
  Joints positions(const Joints& planned_ones) const;
  Joints rates(const Joints& planned_ones) const;
  // Derivatives by the planned joints, of those by each joint: a column each.
  template <typename Columns>
  Columns by_planned(const Columns& by_each) const {
    if (is_chain_) return by_each;
    Columns sums = Columns::Zero(by_each.rows(), planned);
    for (int k = 0; k < joints(); ++k)
      sums.col(drives[k].planned) += drives[k].multiplier * by_each.col(k);
    return sums;
  }

 private:
  std::vector<std::vector<int>> moving_;
  std::vector<int> last_;  // that each body carries, or itself
  bool is_chain_;
};

// Pinocchio's model of the robot as arrays.
struct Chain {
  std::shared_ptr<const Tree> tree;
  std::vector<Pose> placements;   // of each joint, in the frame of the joint before
  std::vector<Vector3> axes;      // of each joint, unit length, in its own frame; zero if it slides
  std::vector<Vector3> slides;    // where each joint slides to, likewise; zero if it turns
  Joints weights;                 // share of each planned joint in the joint path [1 or rad/m]
  std::vector<double> masses;     // of each body
  std::vector<Vector3> centers;   // of mass of each body, in the frame of its joint
  std::vector<Matrix3> inertias;  // of each body about its centre of mass
  Pose tip;                       // of the end effector, in the frame of the joint that moves it

  // Those that are planned.
  int joints() const { return tree->planned; }
  // The frame of a joint, by an angle [rad] or a way [m] from where it is at zero.
  Pose moved(const Pose& at, int joint, double by) const;
  // The frame of a body, from that of the base.
  Pose body(Pose base, int number, const Joints& positions) const;
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
  std::shared_ptr<const Tree> tree;
  Matrix6J screws;  // S_k: motion of what is beyond joint k, per rate
  std::array<Inertia, kMaxJoints + 1> body;
  std::array<Inertia, kMaxJoints + 1> composite;  // I^c_k: of body k and all beyond
  Pose tip;

  Posture(const Chain& chain, const Joints& joints);

  // The twist of each body, by that of the base and the rates of the planned joints.
  std::array<Vector6, kMaxJoints + 1> twists(const Vector6& base, const Joints& rates) const;
  // Of the joints, without those that do not move the end effector.
  Matrix6J of_tip(Matrix6J by_each) const;
};

// Adds to what each body has what the bodies have that it carries.
template <typename Each>
void add_beyond(const Tree& tree, Each& of_bodies) {
  for (int k = tree.joints() - 1; k >= 0; --k) of_bodies[tree.before[k]] += of_bodies[k + 1];
}

}  // namespace ff

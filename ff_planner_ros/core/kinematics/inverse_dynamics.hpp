// Forces in a free-flyer that nothing pushes, and their derivatives: the recursive Newton-Euler
// algorithm [Featherstone, 2008; Carpentier and Mansard, 2018], all of it in base axes.
#pragma once
#include "kinematics/chain.hpp"

namespace ff {

// A body that a link holds, in base axes.
struct HeldBody {
  int number;  // of the link among the bodies
  Inertia inertia;
  Matrix6 frame;  // to base axes from those in which the wrench is told
};

class InverseDynamics {
 public:
  // A row a force; a column a joint position, then one a velocity of base and joints, then one a
  // joint acceleration.
  using Derivatives = RowMajor;

  Joints torques;

  // posture: kept as long as this. base_twist: in base axes.
  InverseDynamics(const Posture& posture, Base base, const Vector6& base_twist, const Joints& rates,
                  const Joints& accelerations);

  Derivatives torques_by() const;

  // Force first, then torque about the origin of the body's frame.
  Vector6 wrench(const HeldBody& body) const;
  Derivatives wrench_by(const HeldBody& body) const;

 private:
  struct Forces {
    Derivatives by;
    Eigen::Matrix<double, Eigen::Dynamic, 6> by_base;  // by the base's acceleration

    Forces(int count, int columns) : by(Derivatives::Zero(count, columns)), by_base(count, 6) {}
  };

  // How the force that turns with a joint, and all that it carries, changes.
  struct Beyond {
    std::array<Matrix6, kMaxJoints + 1> rates;  // of the inertia of a body and all beyond
    Matrix6J by_joints, by_rates, by_accelerations;

    explicit Beyond(const InverseDynamics& of);
    // Of the force along a direction, by the joints from one on, so many.
    void write(Eigen::Ref<Eigen::RowVectorXd> to, const Vector6& direction, int first,
               int count) const;
  };

  int joints() const { return static_cast<int>(posture_.screws.cols()); }
  int columns() const { return 3 * joints() + 6; }

  // Of the base's twist: those that neither table nor wheels hold.
  static std::vector<int> free_rows(Base base);

  static Matrix6 turning(const Inertia& inertia, const Vector6& twist);

  // All that is beyond a joint turns with it, but for the twist and the acceleration that the joint
  // itself moves at: this much of the twist, negative, and of the acceleration.
  Vector6 carried(int joint) const;
  Vector6 not_turned(int joint) const;

  // Writes how a force changes along a direction that turns with the joints that move a body, as
  // all does that exerts it.
  void write(Forces& to, int row, const Vector6& direction, const Inertia& inertia,
             const Vector6& momentum, const Matrix6& rate, int body) const;

  // With the change of the base's acceleration; by the planned joints.
  Derivatives with_free_base(const Forces& forces, const Beyond& beyond) const;

  // The accelerations of the base that take up forces on it.
  Vector6 base_acceleration(const Vector6& force) const;
  RowMajor base_accelerations(const RowMajor& forces) const;

  template <typename Of>
  using OfBodies = std::array<Of, kMaxJoints + 1>;

  const Posture& posture_;
  std::vector<int> free_;
  OfBodies<Vector6> twists_, accelerations_;
  OfBodies<Vector6> momenta_, forces_;  // of a body and all beyond
};

}  // namespace ff

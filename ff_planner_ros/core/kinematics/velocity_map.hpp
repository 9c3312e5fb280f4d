// The momentum-constrained velocity map of Eqs. (27)-(32) and its exact derivatives.
//
// Given configuration, total momentum and wanted end-effector twist, joint rates and base twist are
// together the solution of
//
//     minimise 1/2 |W (theta_dot - z)|^2   subject to   A v = b,   A = [H; J],   b = [h; w]
//
// with H the momentum map, J the end-effector Jacobian, h the momentum in the frame of the base and
// w the wanted twist in that of the end effector. The bias z is zero in the paper, and the weights
// W of the joints are 1: those that slide have others.
#pragma once
#include "kinematics/chain.hpp"

namespace ff {

// Derivatives along some directions, a column each.
template <int columns>
constexpr int kOrder = columns == 1 ? Eigen::ColMajor : Eigen::RowMajor;
template <int columns>
using Along =
    Eigen::Matrix<double, Eigen::Dynamic, columns, kOrder<columns>, kMaxVelocities, columns>;
template <int columns>
using Twists = Eigen::Matrix<double, 6, columns, kOrder<columns>>;

// A matrix, whichever way it is stored.
struct Strided {
  const double* data;
  Eigen::Index rows, cols, row_stride, col_stride;
};

// Adds sign A B to C, a row at a time: where A is stored by columns and B by rows, Eigen would go
// entry by entry. The strides are those of the rows.
template <int columns>
void add_rows(const Strided& A, double sign, const double* B, Eigen::Index B_stride, double* C,
              Eigen::Index C_stride, Eigen::Index count) {
  using Row = Eigen::Matrix<double, 1, columns>;
  for (Eigen::Index row = 0; row < A.rows; ++row) {
    Eigen::Map<Row> to(C + row * C_stride, count);
    Row sum = to;
    for (Eigen::Index k = 0; k < A.cols; ++k)
      sum += sign * A.data[row * A.row_stride + k * A.col_stride] *
             Eigen::Map<const Row>(B + k * B_stride, count);
    to = sum;
  }
}

// The same of matrices, compiled once for any kind of them.
template <typename To, typename A, typename B>
void add_product(To&& to, const A& a, const B& b, double sign = 1) {
  add_rows<B::ColsAtCompileTime>({a.data(), a.rows(), a.cols(), a.rowStride(), a.colStride()}, sign,
                                 b.data(), b.rowStride(), to.data(), to.rowStride(), b.cols());
}

// Faster than this no arm in space moves, by an order of magnitude; the velocity map says so only
// next to a dynamic singularity [rad/s].
constexpr double kSingularJointRate = 10.0;

struct VelocityMap {
  Velocity v;    // base twist in the base frame, joint rates
  bool regular;  // whether the arm can follow; else nothing else has a meaning

  Posture posture;
  Vector6 h, w, mu;  // the last: multipliers of the twist
  Matrix3 inertial_to_ee;
  Matrix6 to_tip, base_inertia_inverse;  // X: J = X [1 S], H = [I^c_0, I^c_k S_k]
  Matrix6 square_inverse;                // of J_D W^-2 J_D^T, damped
  // Of each joint: I^c_k S_k; base twist per rate, negative; S less it
  Matrix6J momenta, given_way, slack;
  Matrix6J coupling;       // base twist per rate of planned joints, negative
  Matrix6J generalised;    // J_D
  Matrix6J weighted;       // J_D W^-2
  Joints inverse_squares;  // of the weights

  // momentum: total P and L about the inertial origin; twist: linear and angular, inertial axes;
  // bias: z; damping: singular values of J_D that are not much greater are damped.
  VelocityMap(const Chain& chain, const Configuration& q, const Vector6& momentum,
              const Vector6& twist, const Joints& bias, double damping);
};

// How the three parts of the linear system that determines the velocity change with each joint.
// With V_k the twist of body k and G_k the momentum of all from k on,
//     d(H v) / dtheta_k = S_k x* G_k - I^c_k (S_k x V_k),
//     d(J v) / dtheta_k = -X (S_k x V_k),
// and the derivative of A^T lambda, lambda the multipliers, has the form of the first.
class VelocityDerivative {
 public:
  explicit VelocityDerivative(const VelocityMap& map);

  // Derivatives of v along steps dq of the configuration in its tangent space, and of the twist and
  // the bias with them. Each of dtwist and dbias has as many columns as dq.
  template <int columns>
  Along<columns> along(const Along<columns>& dq, const Twists<columns>& dtwist) const {
    const auto moving = dq.template topRows<3>(), turning = dq.template middleRows<3>(3);
    const auto joints = dq.bottomRows(at_.v.size() - 6);
    const Matrix3 force = skew(at_.h.head<3>()), to_tip = at_.to_tip.block<3, 3>(3, 3);
    Twists<columns> momentum = Twists<columns>::Zero(6, dq.cols());  // dh - d(H) v
    add_product(momentum.template topRows<3>(), force, turning);
    add_product(momentum.template bottomRows<3>(), force, moving);
    add_product(momentum.template bottomRows<3>(), skew(at_.h.tail<3>()), turning);
    add_product(momentum, of_momentum_, joints, -1);
    Twists<columns> twist = Twists<columns>::Zero(6, dq.cols());  // dw - d(J) v
    add_product(twist.template topRows<3>(), at_.inertial_to_ee, dtwist.template topRows<3>());
    add_product(twist.template bottomRows<3>(), at_.inertial_to_ee,
                dtwist.template bottomRows<3>());
    Eigen::Matrix<double, 3, columns, kOrder<columns>> turn = to_tip * turning;
    add_product(turn, turning_, joints);
    add_product(twist.template topRows<3>(), skew(at_.w.head<3>()), turn);
    add_product(twist.template bottomRows<3>(), skew(at_.w.tail<3>()), turn);
    add_product(twist, of_twist_, joints, -1);
    Along<columns> rates = Along<columns>::Zero(joints.rows(), dq.cols());
    add_product(rates, of_force_, joints, -1);
    return solved<columns>(momentum, twist, rates);
  }

  // Derivative of v along a step of the bias.
  Velocity along_bias(const Joints& dbias) const;

  // By the configuration, then by the twist; a column a direction.
  RowMajor by_configuration_and_twist() const;

 private:
  // Solves the linear system for v, the base eliminated first; force: on the joints, as the rates
  // that it makes.
  template <int columns>
  Along<columns> solved(const Twists<columns>& momentum, const Twists<columns>& twist,
                        const Along<columns>& force) const {
    Twists<columns> drift = Twists<columns>::Zero(6, twist.cols());
    Twists<columns> slack = twist, multipliers = drift;
    add_product(drift, at_.base_inertia_inverse, momentum);
    add_product(slack, at_.to_tip, drift, -1);
    add_product(slack, at_.generalised, force, -1);
    add_product(multipliers, at_.square_inverse, slack);
    Along<columns> dv(at_.v.size(), drift.cols());
    auto base = dv.template topRows<6>();
    auto rates = dv.bottomRows(at_.v.size() - 6);
    rates = force;
    add_product(rates, at_.weighted.transpose(), multipliers);
    base = drift;
    add_product(base, at_.coupling, rates, -1);
    return dv;
  }

  const VelocityMap& at_;
  Matrix6J of_momentum_, of_twist_;
  MatrixJJ of_force_;
  Matrix3J turning_;
};

}  // namespace ff

#include "kinematics/velocity_map.hpp"

#include "kinematics/cholesky.hpp"

namespace ff {
namespace {

// Inverse of L L^T, by that of L.
Matrix6 inverse(const Eigen::LLT<Matrix6>& factors) {
  const Matrix6& L = factors.matrixLLT();
  Eigen::Matrix<double, 6, 6, Eigen::RowMajor> of_factor = Matrix6::Identity();
  for (int row = 0; row < 6; ++row) {
    for (int k = 0; k < row; ++k) of_factor.row(row) -= L(row, k) * of_factor.row(k);
    of_factor.row(row) *= 1 / L(row, row);
  }
  return of_factor.transpose() * of_factor;
}

}  // namespace

VelocityMap::VelocityMap(const Chain& chain, const Configuration& q, const Vector6& momentum,
                         const Vector6& twist, const Joints& bias, double damping)
    : v(6 + chain.joints()), posture(chain, q.joints), momenta(6, posture.tree->joints()) {
  const int n = chain.joints();
  const Matrix3 inertial_to_base = q.attitude.toRotationMatrix().transpose();
  const Vector3 linear = momentum.head<3>();
  h = stack(inertial_to_base * linear,
            inertial_to_base * (momentum.tail<3>() - q.position.cross(linear)));
  inertial_to_ee = posture.tip.rotation.transpose() * inertial_to_base;
  w = stack(inertial_to_ee * twist.head<3>(), inertial_to_ee * twist.tail<3>());
  to_tip = posture.tip.motion_to_inner();

  base_inertia_inverse = posture.composite[0].inverse();
  const Tree& tree = *posture.tree;
  for (int k = 0; k < tree.joints(); ++k)
    momenta.col(k) = posture.composite[k + 1] * posture.screws.col(k);
  given_way = base_inertia_inverse.lazyProduct(momenta);
  coupling = tree.by_planned(given_way);
  const Vector6 drift = base_inertia_inverse * h;
  slack = posture.screws - given_way;
  const Matrix6J of_tip =
      tree.is_chain() ? slack : Matrix6J(posture.of_tip(posture.screws) - given_way);
  generalised = to_tip.lazyProduct(tree.by_planned(of_tip));  // J_D, Eq. (32)
  inverse_squares = chain.weights.array().square().inverse();
  weighted = generalised * inverse_squares.asDiagonal();
  Matrix6 square = damping * damping * Matrix6::Identity();
  for (int k = 0; k < n; ++k) square += generalised.col(k) * weighted.col(k).transpose();
  const Eigen::LLT<Matrix6> factors = cholesky(square);
  square_inverse = inverse(factors);
  mu = square_inverse * Vector6(w - to_tip * drift - generalised * bias);
  v.tail(n) = bias + weighted.transpose() * mu;  // Eq. (31)
  v.head<6>() = drift - coupling * v.tail(n);    // Eq. (27)
  // Written so that it is false, too, where there is no number.
  regular = factors.info() == Eigen::Success &&
            v.tail(n).squaredNorm() < kSingularJointRate * kSingularJointRate;
}

VelocityDerivative::VelocityDerivative(const VelocityMap& map)
    : at_(map), of_momentum_(6, map.momenta.cols()), of_twist_(6, map.momenta.cols()) {
  const Velocity& v = map.v;
  const Tree& tree = *at_.posture.tree;
  const int n = tree.joints();
  const Matrix6J& S = at_.posture.screws;
  const Vector6 pull = at_.to_tip.transpose() * at_.mu;  // of the twist's multiplier, at the base
  const Vector6 a = at_.base_inertia_inverse * pull;     // the momentum's multiplier
  const auto V = at_.posture.twists(v.head<6>(), v.tail(v.size() - 6));
  std::array<Vector6, kMaxJoints + 1> G;
  for (int k = 0; k <= n; ++k) G[k] = at_.posture.body[k] * V[k];
  add_beyond(tree, G);

  Matrix6J of_base_force(6, n), carried(6, n);
  for (int k = 0; k < n; ++k) {
    const Inertia& beyond = at_.posture.composite[k + 1];
    const Vector6 s = S.col(k), swept = cross_motion(s, V[k + 1]);
    of_momentum_.col(k) = cross_force(s, G[k + 1]) - beyond * swept;
    of_twist_.col(k) = -(at_.to_tip * swept);
    carried.col(k) = cross_motion(s, a);
    Vector6 pushed = beyond * a;
    if (tree.moves_tip(k)) pushed -= pull;
    of_base_force.col(k) = cross_force(s, pushed) - beyond * carried.col(k);
  }
  of_force_.resize(n, n);
  for (int k = 0; k < n; ++k)
    for (int i = 0; i < n; ++i) {
      if (tree.moves(i, k + 1)) {
        of_force_(i, k) = at_.slack.col(i).dot(of_base_force.col(k));
        continue;
      }
      // What is beyond joint i does not move with it; on another branch, nothing does.
      const double own = tree.moves(k, i + 1) ? -at_.momenta.col(i).dot(carried.col(k)) : 0;
      of_force_(i, k) = own - at_.given_way.col(i).dot(of_base_force.col(k));
    }
  if (!tree.is_chain()) {
    of_momentum_ = tree.by_planned(of_momentum_);
    of_twist_ = tree.by_planned(at_.posture.of_tip(of_twist_));
    of_force_ =
        tree.by_planned(MatrixJJ(tree.by_planned(of_force_).transpose())).transpose().eval();
  }
  for (int k = 0; k < tree.planned; ++k) of_force_.row(k) *= at_.inverse_squares[k];
  const Matrix6J turned = tree.is_chain() ? S : tree.by_planned(at_.posture.of_tip(S));
  turning_ = at_.to_tip.block<3, 3>(3, 3).lazyProduct(turned.bottomRows<3>());
}

Velocity VelocityDerivative::along_bias(const Joints& dbias) const {
  return solved<1>(Vector6::Zero(), Vector6::Zero(), Along<1>(dbias));
}

RowMajor VelocityDerivative::by_configuration_and_twist() const {
  const Eigen::Index size = at_.v.size();
  Twists<Eigen::Dynamic> twists = Twists<Eigen::Dynamic>::Zero(6, size + 6);
  twists.rightCols<6>().setIdentity();
  return along<Eigen::Dynamic>(Along<Eigen::Dynamic>::Identity(size, size + 6), twists);
}

}  // namespace ff

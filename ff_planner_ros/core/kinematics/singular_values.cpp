#include "kinematics/singular_values.hpp"

#include <Eigen/Jacobi>

#include "kinematics/cholesky.hpp"

namespace ff {
namespace {

// Returns the eigenvector of a symmetric matrix's smallest eigenvalue, by Jacobi's rotations: each
// makes one element off the diagonal zero. Sweeps over all of them converge quadratically.
Vector6 smallest_eigenvector(Matrix6 matrix) {
  constexpr int kSweeps = 12;  // twice as many as a matrix of this size needs
  Matrix6 vectors = Matrix6::Identity();
  Eigen::JacobiRotation<double> turn;
  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    bool is_diagonal = true;
    for (int p = 0; p < 5; ++p)
      for (int q = p + 1; q < 6; ++q) {
        if (!turn.makeJacobi(matrix, p, q)) continue;
        is_diagonal = false;
        matrix.applyOnTheLeft(p, q, turn.adjoint());
        matrix.applyOnTheRight(p, q, turn);
        vectors.applyOnTheRight(p, q, turn);
      }
    if (is_diagonal) break;
  }
  Eigen::Index smallest;
  matrix.diagonal().minCoeff(&smallest);
  return vectors.col(smallest);
}

// Whether all eigenvalues of a symmetric matrix are above a bound, beyond doubt: that takes a tenth
// of the time of the eigenvalues.
bool is_surely_above(const Matrix6& matrix, double bound) {
  const double beyond_rounding = 1.001 * bound + 1e-12 * matrix.trace();
  const Matrix6 rest = matrix - beyond_rounding * Matrix6::Identity();
  return cholesky(rest).info() == Eigen::Success;
}

}  // namespace

SingularValue smallest_singular_value(const Chain& chain, const Joints& joints,
                                      const Vector6& movable, double interest) {
  const Posture at(chain, joints);
  const Tree& tree = *at.tree;
  const int n = tree.planned, each = tree.joints();
  const Matrix6J& S = at.screws;
  const Matrix6 X = Pose{at.tip.position, Matrix3::Identity()}.motion_to_inner();
  const Matrix6 borne = Vector6(Vector6::Ones() - movable).asDiagonal();
  const Matrix6 only = movable.asDiagonal();
  const Matrix6 base_inertia = only * at.composite[0].matrix() * only + borne;
  const Matrix6 base_inverse = solved(cholesky(base_inertia), only);
  Matrix6J momenta(6, each);
  for (int k = 0; k < each; ++k) momenta.col(k) = at.composite[k + 1] * S.col(k);
  const Matrix6J of_each = only * X * (at.of_tip(S) - base_inverse * momenta);
  const Matrix6J unweighted = tree.by_planned(of_each);  // J_D
  const Joints rates_per_share = chain.weights.cwiseInverse();
  const Matrix6J generalised = unweighted * rates_per_share.asDiagonal();

  // The smaller of J_D J_D^T and J_D^T J_D has as many eigenvalues as J_D has singular values. What
  // it does not fill of six rows gets an eigenvalue beyond all of them.
  const double beyond = 1 + 2 * generalised.squaredNorm();
  Matrix6 square = beyond * borne;
  Vector6 u;
  Joints r(n);
  if (n >= movable.sum()) {
    square += generalised * generalised.transpose();
    if (is_surely_above(square, interest * interest)) return {interest, Joints::Zero(n)};
    u = smallest_eigenvector(square);
    r = generalised.transpose() * u;
    r.normalize();
  } else {
    square = beyond * Matrix6::Identity();
    square.topLeftCorner(n, n) = generalised.transpose() * generalised;
    if (is_surely_above(square, interest * interest)) return {interest, Joints::Zero(n)};
    r = smallest_eigenvector(square).head(n);
    u = generalised * r;
    u.normalize();
  }
  SingularValue found{u.dot(generalised * r), Joints(n)};
  r = r.cwiseProduct(rates_per_share);

  const auto V = at.twists(-(base_inverse * (momenta * tree.rates(r))), r);  // of each body
  std::array<Vector6, kMaxJoints + 1> G;  // momentum of a body and of all that it carries
  for (int k = 0; k <= each; ++k) G[k] = at.body[k] * V[k];
  add_beyond(tree, G);
  const Vector6& of_tip = V[tree.tip];
  JointRow by_each(each);
  for (int k = 0; k < each; ++k) {
    const Vector6 s = S.col(k);
    const Vector6 momentum =
        cross_force(s, G[k + 1]) - at.composite[k + 1] * cross_motion(s, V[k + 1]);
    Vector6 change = -(base_inverse * momentum);
    Vector3 moved = Vector3::Zero();
    if (tree.moves_tip(k)) {
      // The base gives way; the joints beyond turn with joint k, and so does the end effector.
      change = cross_motion(s, of_tip - V[k + 1]) - base_inverse * momentum;
      moved = s.head<3>() + s.tail<3>().cross(at.tip.position);
    }
    Vector6 of_twist = X * change;
    of_twist.head<3>() += of_tip.tail<3>().cross(moved);
    by_each[k] = u.dot(of_twist);
  }
  found.by_joints = tree.by_planned(by_each).transpose();
  return found;
}

}  // namespace ff

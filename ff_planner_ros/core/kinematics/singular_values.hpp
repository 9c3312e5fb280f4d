// The smallest singular value of the generalised Jacobian, Eq. (32), and its derivatives.
#pragma once
#include "kinematics/chain.hpp"

namespace ff {

struct SingularValue {
  double value;
  Joints by_joints;
};

// J_D W^-1 with the joints' weights W, and J_D = X (S - C) with C = H_b^-1 H_m, in the axes of the
// base: X leads from the base to the end effector, S are the joints' screws, H_b and H_m the
// columns of the momentum map.
//
// With u and r its singular vectors, d sigma / dtheta_k = u^T (dJ_D / dtheta_k) r. That is how the
// twist of the end effector changes at joint rates r, which let the base move by -C r.
//
// interest: returned for a singular value that surely is larger, without derivatives.
// movable: 1 where the base can move, 0 where a table bears it: of such rows nothing is left.
SingularValue smallest_singular_value(const Chain& chain, const Joints& joints,
                                      const Vector6& movable, double interest);

}  // namespace ff

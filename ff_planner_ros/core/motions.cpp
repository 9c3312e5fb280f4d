// Motions of both path families. Compiled beside the rest: they are half of the work.
#include "bind_driven_motion.hpp"
#include "bind_end_effector.hpp"
#include "bindings.hpp"

namespace ff {

void bind_motions(py::module_& m) {
  bind_driven_motion(m);
  bind_end_effector(m);
}

}  // namespace ff

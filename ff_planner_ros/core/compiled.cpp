// The module `ff_planner_ros.core.compiled`; its types for Python are in compiled.pyi.
#include "bind_chain.hpp"
#include "bind_clearance.hpp"
#include "bind_driven_motion.hpp"
#include "bind_end_effector.hpp"
#include "bind_search.hpp"

PYBIND11_MODULE(compiled, m) {
  m.doc() = "Numerics of the search, compiled.";
  ff::bind_chain(m);
  ff::bind_end_effector(m);
  ff::bind_driven_motion(m);
  ff::bind_clearance(m);
  ff::bind_search(m);
}

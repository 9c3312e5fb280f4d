// The module `ff_planner_ros.core.compiled`; its types for Python are in compiled.pyi.
#include "bind_bodies.hpp"
#include "bind_chain.hpp"
#include "bind_clearance.hpp"
#include "bind_search.hpp"
#include "bind_singular_values.hpp"
#include "bindings.hpp"

PYBIND11_MODULE(compiled, m) {
  m.doc() = "Numerics of the search, compiled.";
  m.attr("SOURCES_DIGEST") = CORE_SOURCES_DIGEST;
  ff::bind_chain(m);
  ff::bind_clearance(m);
  ff::bind_bodies(m);
  ff::bind_motions(m);
  ff::bind_search(m);
  ff::bind_singular_values(m);
}

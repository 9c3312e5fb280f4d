// The module `ff_planner_ros.core.compiled`; its types for Python are in compiled.pyi.
#include "bindings/bindings.hpp"

PYBIND11_MODULE(compiled, m) {
  m.doc() = "Numerics of the search, compiled.";
  m.attr("SOURCES_DIGEST") = CORE_SOURCES_DIGEST;
  ff::bind_kinematics(m);
  ff::bind_clearance(m);
  ff::bind_bodies(m);
  ff::bind_obstacles(m);
  ff::bind_path_requirements(m);
  ff::bind_load_requirements(m);
  ff::bind_distance_requirements(m);
  ff::bind_goal_requirements(m);
  ff::bind_path_program(m);
  ff::bind_driven_motion(m);
  ff::bind_end_effector(m);
  ff::bind_objectives(m);
  ff::bind_limit_rows(m);
  ff::bind_optimisation(m);
}

// The subjects of the module, each compiled by itself.
#pragma once
#include <pybind11/pybind11.h>

namespace ff {

void bind_kinematics(pybind11::module_& m);
void bind_clearance(pybind11::module_& m);
void bind_bodies(pybind11::module_& m);
void bind_obstacles(pybind11::module_& m);
void bind_driven_motion(pybind11::module_& m);
void bind_end_effector(pybind11::module_& m);
void bind_objectives(pybind11::module_& m);
void bind_limit_rows(pybind11::module_& m);
void bind_optimisation(pybind11::module_& m);
void bind_path_requirements(pybind11::module_& m);
void bind_load_requirements(pybind11::module_& m);
void bind_distance_requirements(pybind11::module_& m);
void bind_goal_requirements(pybind11::module_& m);
void bind_path_program(pybind11::module_& m);

}  // namespace ff

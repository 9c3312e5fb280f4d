// The subjects of the module, each compiled by itself.
#pragma once
#include <pybind11/pybind11.h>

// Of the sources that the module is built of; the build writes it.
extern const char kSourcesDigest[];

namespace ff {

void bind_kinematics(pybind11::module_& m);
void bind_motion(pybind11::module_& m);
void bind_collision(pybind11::module_& m);
void bind_requirements(pybind11::module_& m);
void bind_program(pybind11::module_& m);
void bind_optimisation(pybind11::module_& m);

}  // namespace ff

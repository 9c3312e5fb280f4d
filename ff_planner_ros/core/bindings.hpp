// What the parts of the module that are compiled side by side offer to it.
#pragma once
#include "arrays.hpp"

namespace ff {

void bind_clearance(py::module_& m);
void bind_driven_motion(py::module_& m);
void bind_end_effector(py::module_& m);
void bind_search(py::module_& m);

}  // namespace ff

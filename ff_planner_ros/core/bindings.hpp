// What the parts of the module that are compiled apart offer to it.
#pragma once
#include "arrays.hpp"

namespace ff {

void bind_clearance(py::module_& m);
void bind_end_effector(py::module_& m);

}  // namespace ff

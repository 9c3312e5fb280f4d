// Python's way to the motion of a system whose joints are driven.
#pragma once
#include <pybind11/pybind11.h>

namespace ff {

void bind_driven_motion(pybind11::module_& m);

}  // namespace ff

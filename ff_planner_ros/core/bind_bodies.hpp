// Python's way to the distances of bodies.
#pragma once
#include <pybind11/pybind11.h>

namespace ff {

void bind_bodies(pybind11::module_& m);

}  // namespace ff

// What the parts of the module that are compiled side by side offer to it.
#pragma once
#include "arrays.hpp"

namespace ff {

void bind_motions(py::module_& m);

}  // namespace ff

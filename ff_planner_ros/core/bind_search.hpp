// Python's way to the objective and to the certificate of a search.
#pragma once
#include <pybind11/pybind11.h>

namespace ff {

void bind_search(pybind11::module_& m);

}  // namespace ff

// A table by itself, linearised at once into dense normal equations: for estimates that change with every measurement,
// where a problem is used a single time.
#pragma once

#include <cstdint>

#include "table.hpp"

namespace teamslam {

// H (n x n, both triangles) and g (n) over the unknowns of all variables, in their order; returns the cost. Throws
// std::invalid_argument as Problem does.
double normal_equations(int64_t variables, const int32_t* kinds, const TableInput& input, const double* state,
                        double* H, double* g);

}  // namespace teamslam

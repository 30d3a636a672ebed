#include "normal_equations.hpp"

#include <algorithm>
#include <vector>

#include "problem.hpp"

namespace teamslam {

double normal_equations(int64_t variables, const int32_t* kinds, const TableInput& input, const double* state,
                        double* H, double* g) {
  Problem problem(variables, kinds, std::vector<uint8_t>(variables, 0).data());
  problem.add_table(input);
  problem.freeze();
  problem.check_state(state);
  std::vector<double> system(problem.system_size());
  const double cost = problem.linearise(state, {}, 1, system.data());

  const BlockPattern& pattern = problem.pattern();
  const int64_t n = pattern.scalars();
  std::fill(H, H + n * n, 0.0);
  std::copy_n(system.begin() + pattern.size(), n, g);
  for (int32_t c = 0; c < pattern.variables(); ++c)
    for (int64_t k = pattern.column_start[c]; k < pattern.column_start[c + 1]; ++k) {
      const double* value = system.data() + pattern.value_start[k];
      const int64_t first_row = pattern.scalar_start[pattern.row[k]], first_column = pattern.scalar_start[c];
      for (int64_t j = first_column; j < first_column + pattern.dof[c]; ++j)
        for (int64_t i = first_row; i < first_row + pattern.dof[pattern.row[k]]; ++i)
          H[i * n + j] = H[j * n + i] = *value++;
    }
  return cost;
}

}  // namespace teamslam

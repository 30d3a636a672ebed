// Measurements that are linearised elsewhere (a user's own sensor in NumPy): only their places in H and g are ours.
#pragma once

#include <cstdint>
#include <vector>

#include "term.hpp"
#include "variables.hpp"

namespace teamslam {

class UserBlocks final : public Term {
 public:
  // count rows, each between `keys` different variables and with `residual_rows` residuals.
  // Throws std::invalid_argument.
  UserBlocks(const Variables& variables, int64_t count, int64_t keys, const int64_t* index, int64_t residual_rows);

  int64_t count() const { return count_; }
  int64_t residual_size() const { return residual_rows_; }
  // Columns of every row's Jacobian: all rows relate the same kinds.
  int64_t columns() const { return columns_; }

  // Adds J'J and J'e of this chunk's rows: e is count x residual_size, J is count x residual_size x columns, row-major,
  // both whitened and weighted.
  void add(int32_t chunk, const double* e, const double* J, double* system) const;

  void weigh(std::vector<double>& work) const override;
  void arrange(const std::vector<int32_t>& chunk_of_variable, int32_t chunks) override;
  void couple(Couplings& couplings) override;
  void place(int32_t chunk, Layout& layout) override;
  double linearise(int32_t, const double*, double*) const override { return 0.0; }
  double cost(int32_t, const double*) const override { return 0.0; }

 private:
  int32_t free_of(int64_t row, int64_t key) const { return variables_.free[index_[keys_ * row + key]]; }

  const Variables& variables_;
  int64_t count_, keys_, residual_rows_, columns_ = 0, pairs_;
  std::vector<int32_t> index_;
  std::vector<int64_t> column_of_key_;  // size keys + 1
  std::vector<std::vector<int64_t>> rows_of_chunk_;
  std::vector<int64_t> slots_;                            // count x pairs
  std::vector<int64_t> diagonals_, gradients_, couplings_;  // count x keys, count x keys, count x pairs
};

}  // namespace teamslam

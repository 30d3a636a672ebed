#include "user_blocks.hpp"

#include "checks.hpp"

namespace teamslam {

UserBlocks::UserBlocks(const Variables& variables, int64_t count, int64_t keys, const int64_t* index,
                       int64_t residual_rows)
    : variables_(variables), count_(count), keys_(keys), residual_rows_(residual_rows), pairs_(keys * (keys - 1) / 2) {
  if (count <= 0 || keys <= 0 || residual_rows <= 0)
    refuse("blocks: expected at least one row, one key and one residual");
  index_.reserve(count * keys);
  for (int64_t row = 0; row < count; ++row)
    for (int64_t key = 0; key < keys; ++key) {
      const int64_t variable = index[keys * row + key];
      if (variable < 0 || variable >= variables.count())
        refuse("blocks: row ", row, " names variable ", variable, ", but there are ", variables.count());
      for (int64_t other = 0; other < key; ++other)
        if (variable == index[keys * row + other]) refuse("blocks: row ", row, " names variable ", variable, " twice");
      if (variables.kind[variable] != variables.kind[index[key]])
        refuse("blocks: row ", row, " relates other kinds of variables than row 0; add them apart");
      index_.push_back(static_cast<int32_t>(variable));
    }
  for (int64_t key = 0; key < keys; ++key) {
    column_of_key_.push_back(columns_);
    columns_ += dof(variables.kind[index[key]]);
  }
  column_of_key_.push_back(columns_);
}

void UserBlocks::weigh(std::vector<double>& work) const {
  for (int64_t row = 0; row < count_; ++row)
    work[index_[keys_ * row]] += 50.0 + static_cast<double>(residual_rows_ * columns_ * columns_);
}

void UserBlocks::arrange(const std::vector<int32_t>& chunk_of_variable, int32_t chunks) {
  rows_of_chunk_.resize(chunks);
  for (int64_t row = 0; row < count_; ++row) rows_of_chunk_[chunk_of_variable[index_[keys_ * row]]].push_back(row);
}

void UserBlocks::couple(Couplings& couplings) {
  for (int64_t row = 0; row < count_; ++row)
    for (int64_t j = 0; j < keys_; ++j)
      for (int64_t i = 0; i < j; ++i) slots_.push_back(couplings.add(free_of(row, i), free_of(row, j)));
  diagonals_.resize(count_ * keys_);
  gradients_.resize(count_ * keys_);
  couplings_.resize(count_ * pairs_);
}

void UserBlocks::place(int32_t chunk, Layout& layout) {
  for (int64_t row : rows_of_chunk_[chunk]) {
    int64_t pair = pairs_ * row;
    for (int64_t j = 0; j < keys_; ++j) {
      diagonals_[keys_ * row + j] = layout.diagonal(free_of(row, j));
      gradients_[keys_ * row + j] = layout.gradient(free_of(row, j));
      for (int64_t i = 0; i < j; ++i, ++pair) {
        const int64_t start = layout.coupling(slots_[pair]);
        couplings_[pair] = free_of(row, i) > free_of(row, j) ? ~start : start;
      }
    }
  }
}

void UserBlocks::add(int32_t chunk, const double* e, const double* J, double* system) const {
  // target (columns of left x columns of right, row-major) += J_left' J_right
  const auto add_product = [&](const double* jacobian, int64_t left, int64_t right, double* target) {
    const int64_t width = column_of_key_[right + 1] - column_of_key_[right];
    for (int64_t p = column_of_key_[left]; p < column_of_key_[left + 1]; ++p, target += width)
      for (int64_t q = 0; q < width; ++q) {
        double sum = 0.0;
        for (int64_t r = 0; r < residual_rows_; ++r)
          sum += jacobian[columns_ * r + p] * jacobian[columns_ * r + column_of_key_[right] + q];
        target[q] += sum;
      }
  };
  for (int64_t row : rows_of_chunk_[chunk]) {
    const double* jacobian = J + row * residual_rows_ * columns_;
    int64_t pair = pairs_ * row;
    for (int64_t j = 0; j < keys_; ++j) {
      add_product(jacobian, j, j, system + diagonals_[keys_ * row + j]);
      double* gradient = system + gradients_[keys_ * row + j];
      for (int64_t p = column_of_key_[j]; p < column_of_key_[j + 1]; ++p)
        for (int64_t r = 0; r < residual_rows_; ++r)
          gradient[p - column_of_key_[j]] += jacobian[columns_ * r + p] * e[row * residual_rows_ + r];
      for (int64_t i = 0; i < j; ++i, ++pair) {
        // Blocks are column-major: the rows of the later variable run fastest.
        if (couplings_[pair] >= 0)
          add_product(jacobian, i, j, system + couplings_[pair]);
        else
          add_product(jacobian, j, i, system + ~couplings_[pair]);
      }
    }
  }
}

}  // namespace teamslam
